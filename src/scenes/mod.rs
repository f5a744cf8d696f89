//! Procedural scenes shared by the tests, the examples and the benches.
//!
//! Every scene is made in code from fixed numbers, so that a result can be repeated without a
//! download. Lengths are metres, Y points up, the axes are right-handed, and a triangle's corners
//! run counter-clockwise seen from the side its normals point to.

mod builder;
mod closed_room;
mod colonnade;
mod cornell;
mod dominoes;
mod fence;
mod grass;
mod hash;
mod holes;
mod statue;
mod stress;
#[cfg(test)]
mod tests;

pub use closed_room::closed_room;
pub use colonnade::colonnade;
pub use cornell::cornell;
pub use dominoes::dominoes;
pub use fence::fence;
pub use grass::{grass, grass_cut_out};
pub use holes::{HoleTest, Holes};
pub use statue::statue;
pub use stress::{DEFAULT_STRESS_TRIANGLES, MAX_STRESS_TRIANGLES, stress};

/// A triangle mesh in parts, its materials and cameras worth looking from.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The name [`by_name`] knows the scene by.
    pub name: &'static str,
    /// Vertex positions, in metres.
    pub positions: Vec<[f32; 3]>,
    /// Unit vertex normals for shading, one to a position, on the triangles' front side.
    pub normals: Vec<[f32; 3]>,
    /// Three indices into `positions` and `normals` to a triangle.
    pub indices: Vec<u32>,
    /// Runs of `indices` that share a material. In order they cover `indices` once, with no gap.
    pub parts: Vec<Part>,
    /// What [`Part::material`] points into.
    pub materials: Vec<Material>,
    /// Two or more cameras: the first shows the whole, at least one stands close to geometry.
    pub views: Vec<View>,
    /// A radius of ambient occlusion, in metres, that suits the size of what is seen.
    pub ao_radius: f32,
    /// The holes of alpha-tested triangles, if there are any.
    pub holes: Option<Holes>,
}

impl Scene {
    /// How many triangles the scene holds.
    pub fn triangle_count(&self) -> usize {
        self.indices.len() / 3
    }

    /// The material table as the passes take it: [`Part::material`] points into it.
    pub fn material_table(&self) -> Vec<crate::Material> {
        self.materials.iter().copied().map(Into::into).collect()
    }

    /// The material of each triangle, as the ray tracer takes them.
    pub fn triangle_materials(&self) -> Vec<crate::Material> {
        self.parts
            .iter()
            .flat_map(|part| {
                let material = self.materials[part.material as usize].into();
                std::iter::repeat_n(material, part.index_count as usize / 3)
            })
            .collect()
    }
}

/// A run of a scene's indices drawn with one material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Where the run starts in [`Scene::indices`].
    pub first_index: u32,
    /// How many indices it has: three to a triangle.
    pub index_count: u32,
    /// Which of [`Scene::materials`] it has.
    pub material: u32,
}

/// A Lambertian surface, which may emit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Share of the light falling on the surface that it sends back: linear RGB, 0 to 1.
    pub albedo: [f32; 3],
    /// Radiosity emitted by the front side, in W/m²: linear RGB.
    pub emission: [f32; 3],
    /// Whether the back side emits it too.
    pub double_sided: bool,
}

impl From<Material> for crate::Material {
    fn from(material: Material) -> Self {
        Self {
            albedo: material.albedo,
            emission: material.emission,
            double_sided: u32::from(material.double_sided),
            ..Self::default()
        }
    }
}

/// A camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// A name, unique within the scene.
    pub name: &'static str,
    /// Where the camera stands, in metres.
    pub eye: [f64; 3],
    /// A point in the middle of the image.
    pub target: [f64; 3],
    /// A direction that points up in the image; it need not be square to the line of sight.
    pub up: [f64; 3],
    /// The angle from the bottom to the top of the image, in degrees.
    pub vertical_fov_degrees: f64,
    /// Distance of the near plane, in metres; no geometry that should be seen is nearer.
    pub near: f64,
}

type Entry = (&'static str, fn() -> Scene);

/// Scenes of one purpose, which are known by their names alone.
const OF_ONE_PURPOSE: [Entry; 3] = [
    (grass::NAME, grass),
    (grass::CUT_OUT_NAME, grass_cut_out),
    (statue::NAME, statue),
];

const SCENES: [Entry; 6] = [
    (cornell::NAME, cornell),
    (colonnade::NAME, colonnade),
    (dominoes::NAME, dominoes),
    (fence::NAME, fence),
    (closed_room::NAME, closed_room),
    (stress::NAME, || stress(DEFAULT_STRESS_TRIANGLES)),
];

/// Builds every scene but those of one purpose, the two lawns and the [`statue()`]; the stress scene with
/// [`DEFAULT_STRESS_TRIANGLES`].
pub fn all() -> Vec<Scene> {
    SCENES.iter().map(|(_, build)| build()).collect()
}

/// Builds the scene of that name, or nothing where there is none.
pub fn by_name(name: &str) -> Option<Scene> {
    SCENES
        .iter()
        .chain(&OF_ONE_PURPOSE)
        .find(|(known, _)| *known == name)
        .map(|(_, build)| build())
}
