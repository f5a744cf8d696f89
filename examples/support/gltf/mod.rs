//! glTF 2.0 files as scenes: every triangle of the default scene, in world space, with what the materials reflect and emit.
//!
//! The `gltf` crate reads the JSON and checks that its indices point somewhere. What it leaves unchecked is checked here: it
//! panics or keeps silent where buffers are too short for what is said of them, so accessors are read in `accessors`.

mod accessors;
mod buffers;
mod deform;
mod document;
mod images;
mod lights;
mod materials;
mod nodes;
mod primitives;
mod triangles;

use std::{cell::RefCell, path::Path};

use deep_screen_space::{
    Light,
    glam::{DMat4, DVec3},
    scenes::{HoleTest, Holes, Part, Scene},
};

use super::world::{World, bounds};
pub use lights::FileCamera;

use buffers::Buffers;
use images::{AlphaMap, Images};
use materials::{Hole, Materials};
use nodes::Nodes;
use primitives::Shape;

/// Corners of triangles that a scene may have, all instances together: 44 million triangles.
const MAX_CORNERS: usize = 1 << 27;

/// A scene and what else its file holds.
pub struct Loaded {
    pub world: World,
    /// Perspective cameras of the file.
    pub cameras: Vec<FileCamera>,
    /// Lights of the file.
    pub lights: Vec<Light>,
    /// What was left out, a line each.
    pub notes: Vec<String>,
}

impl From<Scene> for Loaded {
    fn from(scene: Scene) -> Self {
        Self {
            world: scene.into(),
            cameras: Vec::new(),
            lights: Vec::new(),
            notes: Vec::new(),
        }
    }
}

/// Reads a glTF file, binary or JSON with what it names.
///
/// # Errors
/// One line that names the file and what is wrong with it.
pub fn load_gltf(path: &Path) -> Result<Loaded, String> {
    let name = path.display();
    let load = || {
        if !path.is_file() {
            return Err("no such file".into());
        }
        let bytes = std::fs::read(path).map_err(|e| e.to_string())?;
        let folder = path.parent().unwrap_or(Path::new("."));
        read_gltf(&bytes, folder, MAX_CORNERS)
    };
    load().map_err(|e: String| one_line(&format!("{name}: {e}")))
}

/// Reads a glTF file's bytes; other files that it names are looked for in `folder`. No more than `room` corners of triangles
/// are accepted.
///
/// # Errors
/// One line that says what is wrong with it.
pub fn read_gltf(bytes: &[u8], folder: &Path, room: usize) -> Result<Loaded, String> {
    read(bytes, folder, room).map_err(|e| one_line(&e))
}

fn read(bytes: &[u8], folder: &Path, room: usize) -> Result<Loaded, String> {
    let (document, blob) = document::parse(bytes)?;
    let nodes = Nodes::new(&document)?;
    let buffers = Buffers::load(&document, blob, folder)?;
    let notes = Notes::default();
    let file = File {
        images: Images::new(&document, folder),
        document: &document,
        buffers: &buffers,
        nodes: &nodes,
        notes: &notes,
    };
    let mut triangles = Triangles::new(room);
    let wanted = count_corners(&file, room)?;
    if wanted > room {
        return Err(format!(
            "{wanted} corners of triangles are more than {room}"
        ));
    }
    for &index in &nodes.visible {
        draw(&file, index, &mut triangles)?;
    }
    if triangles.indices.is_empty() {
        return Err(format!("nothing to draw: {}", why_nothing(&file)));
    }
    Ok(Loaded {
        world: triangles.finish()?,
        cameras: lights::cameras(&file)?,
        lights: lights::lights(&file)?,
        notes: notes.lines(),
    })
}

/// A parsed file, and all that its parts are read with.
struct File<'a> {
    document: &'a gltf::Document,
    buffers: &'a Buffers,
    images: Images<'a>,
    nodes: &'a Nodes,
    notes: &'a Notes,
}

impl<'a> File<'a> {
    fn node(&self, index: usize) -> Result<gltf::Node<'a>, String> {
        let node = self.document.nodes().nth(index);
        node.ok_or_else(|| format!("there is no node {index}"))
    }
}

/// What was left out, and how often.
#[derive(Default)]
struct Notes(RefCell<Vec<(String, usize)>>);

impl Notes {
    fn add(&self, text: impl Into<String>) {
        let text = text.into();
        let mut notes = self.0.borrow_mut();
        match notes.iter_mut().find(|(known, _)| *known == text) {
            Some((_, count)) => *count += 1,
            None => notes.push((text, 1)),
        }
    }

    fn lines(&self) -> Vec<String> {
        let line = |(text, count): &(String, usize)| match count {
            1 => one_line(text),
            _ => one_line(&format!("{text} ({count} times)")),
        };
        self.0.borrow().iter().map(line).collect()
    }
}

/// A file's own words may hold line breaks, and any number of them.
fn one_line(text: &str) -> String {
    const LONGEST: usize = 400;
    let mut line: String = text
        .chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .take(LONGEST)
        .collect();
    if text.chars().count() > LONGEST {
        line.push('…');
    }
    line
}

fn why_nothing(file: &File<'_>) -> String {
    let notes = file.notes.lines();
    if file.nodes.visible.is_empty() {
        "no node is in the scene".into()
    } else if !file.nodes.visible.iter().any(|&i| {
        file.node(i)
            .is_ok_and(|n| n.mesh().is_some_and(|m| m.primitives().len() > 0))
    }) {
        "no node of the scene has a mesh with primitives".into()
    } else if notes.is_empty() {
        "its primitives have no triangles".into()
    } else {
        notes.join(", ")
    }
}

/// How many corners the scene's triangles have at most: what is too much is refused before any of it is read.
fn count_corners(file: &File<'_>, room: usize) -> Result<usize, String> {
    let mut total = 0_usize;
    for &index in &file.nodes.visible {
        let node = file.node(index)?;
        let Some(mesh) = node.mesh() else {
            continue;
        };
        let instances = file.nodes.instances(file, &node, room)?.len();
        for primitive in mesh.primitives() {
            let corners = primitive
                .indices()
                .or(primitive.get(&gltf::Semantic::Positions))
                .map_or(0, |accessor| {
                    triangles::most_corners(primitive.mode(), accessor.count())
                });
            total = total.saturating_add(corners.saturating_mul(instances));
        }
    }
    Ok(total)
}

/// Adds what a node shows.
fn draw(file: &File<'_>, index: usize, triangles: &mut Triangles) -> Result<(), String> {
    let node = file.node(index)?;
    let Some(mesh) = node.mesh() else {
        return Ok(());
    };
    let instances = file.nodes.instances(file, &node, triangles.room())?;
    for primitive in mesh.primitives() {
        let place = format!("mesh {}, primitive {}", mesh.index(), primitive.index());
        let shape = primitives::read(file, &node, &mesh, &primitive, triangles.room())
            .map_err(|e| format!("{place}: {e}"))?;
        let Some(shape) = shape else {
            continue;
        };
        for &instance in &instances {
            // Joints alone place what is skinned.
            let to_world = if shape.skinned {
                DMat4::IDENTITY
            } else {
                instance
            };
            triangles
                .add(&shape, to_world)
                .map_err(|e| format!("node {index}, {place}: {e}"))?;
        }
    }
    Ok(())
}

/// The holes of a scene's materials, with their pictures at one size; none where there are none.
fn holes(of: &[Option<Hole>], tex_coords: Vec<[f32; 2]>) -> Option<Holes> {
    let mut images: Vec<(usize, &AlphaMap)> = Vec::new();
    for hole in of.iter().flatten() {
        if !images.iter().any(|(image, _)| *image == hole.image) {
            images.push((hole.image, &*hole.map));
        }
    }
    if images.is_empty() {
        return None;
    }
    let largest = |axis: usize| images.iter().map(|(_, map)| map.size[axis]).max();
    let size = [0, 1].map(|axis| largest(axis).unwrap_or(1));
    let layer = |hole: &Hole| images.iter().position(|(image, _)| *image == hole.image);
    Some(Holes {
        tex_coords,
        size,
        maps: images.iter().map(|(_, map)| map.resized(size)).collect(),
        tests: of
            .iter()
            .map(|hole| {
                let hole = hole.as_ref()?;
                Some(HoleTest {
                    layer: layer(hole)? as u32,
                    threshold: hole.threshold,
                    wrap: hole.wrap,
                })
            })
            .collect(),
    })
}

/// Triangles in world space.
struct Triangles {
    positions: Vec<DVec3>,
    normals: Vec<[f32; 3]>,
    /// Of those that are alpha-tested; else 0.
    tex_coords: Vec<[f32; 2]>,
    indices: Vec<u32>,
    parts: Vec<Part>,
    materials: Materials,
    most: usize,
}

impl Triangles {
    fn new(room: usize) -> Self {
        Self {
            positions: Vec::new(),
            normals: Vec::new(),
            tex_coords: Vec::new(),
            indices: Vec::new(),
            parts: Vec::new(),
            materials: Materials::default(),
            most: room,
        }
    }

    /// How many corners more are accepted.
    fn room(&self) -> usize {
        self.most - self.indices.len()
    }

    fn add(&mut self, shape: &Shape, to_world: DMat4) -> Result<(), String> {
        let placed = triangles::place(shape, to_world)?;
        let base = self.positions.len() as u32;
        self.positions.extend(placed.positions);
        self.normals
            .extend(placed.normals.iter().map(|n| n.as_vec3().to_array()));
        self.tex_coords.extend(placed.tex_coords);
        self.tex_coords.resize(self.positions.len(), [0.0; 2]);
        for group in &shape.groups {
            let hole = group.hole.as_ref();
            let material = self.materials.index(group.material, hole);
            let first_index = self.indices.len() as u32;
            let corners = &placed.triangles[group.first..group.first + group.count];
            self.indices
                .extend(corners.iter().flatten().map(|i| base + i));
            let index_count = self.indices.len() as u32 - first_index;
            match self.parts.last_mut() {
                Some(last) if last.material == material => last.index_count += index_count,
                _ if index_count == 0 => {}
                _ => self.parts.push(Part {
                    first_index,
                    index_count,
                    material,
                }),
            }
        }
        Ok(())
    }

    fn finish(self) -> Result<World, String> {
        let (low, high) = bounds(self.positions.iter().copied());
        if !(low.as_vec3().is_finite() && high.as_vec3().is_finite()) {
            return Err("a position is beyond what f32 can say".into());
        }
        Ok(World {
            scene: Scene {
                name: "gltf",
                positions: Vec::new(),
                normals: self.normals,
                indices: self.indices,
                parts: self.parts,
                holes: holes(&self.materials.holes, self.tex_coords),
                materials: self.materials.list,
                views: Vec::new(),
                ao_radius: f32::INFINITY,
            },
            positions: self.positions,
        })
    }
}
