//! Triangles with holes, of a scene.

use crate::AlphaWrap;

/// Where a scene's triangles are alpha-tested, and the pictures that tell where they are.
#[derive(Clone, Debug, PartialEq)]
pub struct Holes {
    /// Texture coordinates, one to a position.
    pub tex_coords: Vec<[f32; 2]>,
    /// Width and height of each picture, in texels.
    pub size: [u32; 2],
    /// Alpha of each picture, rows from the top.
    pub maps: Vec<Vec<u8>>,
    /// For each of [`Scene::materials`](super::Scene::materials) its test, if it has one; materials beyond the list have none.
    pub tests: Vec<Option<HoleTest>>,
}

/// The test of a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoleTest {
    /// Which of [`Holes::maps`].
    pub layer: u32,
    /// The least alpha that is there, 0…1.
    pub threshold: f32,
    /// What is beyond the picture, along either coordinate.
    pub wrap: [AlphaWrap; 2],
}
