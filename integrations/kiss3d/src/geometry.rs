//! kiss3d's objects as the library's triangles: their data in buffers that shaders may read, once, and their transforms in each
//! frame.

use std::{
    cell::RefCell,
    rc::Rc,
    sync::{Arc, PoisonError},
};

use bytemuck::{Pod, Zeroable};
use deep_screen_space::{
    IndexFormat, Indices, Instances, Material, Mesh, PositionFormat, TransformFormat, Vertices,
};
use kiss3d::{
    context::Context,
    glamx::{Mat3, Mat4, Pose3, Vec3},
    resource::{GPUVec, GpuMesh3d, Texture},
    scene::{InstancesBuffer3d, Object3d, ObjectData3d},
};
use wgpu::{Buffer, BufferUsages};

use crate::error::Error;

/// Of buffers that are this crate's own. kiss3d's have others.
const USAGE: BufferUsages = BufferUsages::STORAGE
    .union(BufferUsages::VERTEX)
    .union(BufferUsages::COPY_DST)
    .union(BufferUsages::COPY_SRC);

/// An object of the scene, whose material tells of it in each frame.
pub struct Adopted {
    pub mesh: Rc<RefCell<GpuMesh3d>>,
    instances: Rc<RefCell<InstancesBuffer3d>>,
    triangles: Option<Triangles>,
}

/// A mesh where shaders may read it.
struct Triangles {
    positions: Buffer,
    vertices: u32,
    indices: Buffer,
    count: u32,
}

/// An object as kiss3d draws it in this frame.
pub struct Drawn {
    /// Which of the adopted objects.
    pub object: usize,
    pose: Mat4,
    scale: Mat3,
    albedo: Vec3,
    emission: Vec3,
    pub culls_backs: bool,
    pub map: Arc<Texture>,
}

/// What the vertex shader and the rays know of an instance.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Instance {
    transform: [[f32; 4]; 4],
    albedo: [f32; 4],
}

/// All triangles of a frame.
#[derive(Default)]
pub struct Triangulation {
    instances: Option<Buffer>,
    materials: Option<Buffer>,
    /// First instance and number of instances of each object.
    ranges: Vec<(u32, u32)>,
    /// Objects whose vertices or indices are others than in the frame before.
    pub changed: Vec<usize>,
}

impl Adopted {
    pub fn new(object: &Object3d) -> Self {
        Self {
            mesh: Rc::clone(object.mesh()),
            instances: Rc::clone(object.instances()),
            triangles: None,
        }
    }

    /// Copies the mesh where it was not, or where it changed since kiss3d drew it last. Whether it did.
    fn update(&mut self, context: &Context, object: usize, drawn: bool) -> Result<bool, Error> {
        let mesh = self.mesh.borrow();
        let coords = mesh.coords().read().unwrap_or_else(PoisonError::into_inner);
        let faces = mesh.faces().read().unwrap_or_else(PoisonError::into_inner);
        let is_new = self.triangles.is_none();
        if !(is_new || drawn && (coords.dirty() || faces.dirty())) {
            return Ok(false);
        }
        let old = self.triangles.take();
        let (positions, indices) =
            old.map_or((None, None), |t| (Some(t.positions), Some(t.indices)));
        self.triangles = Some(Triangles {
            vertices: coords.len() as u32,
            positions: shared(
                context,
                &coords,
                positions,
                Error::Mesh {
                    object,
                    what: "vertices",
                },
            )?,
            count: faces.len() as u32 * 3,
            indices: shared(
                context,
                &faces,
                indices,
                Error::Mesh {
                    object,
                    what: "indices",
                },
            )?,
        });
        Ok(true)
    }
}

/// A buffer with the usage `STORAGE` of what kiss3d has: its own where it has that, or a copy, in the one of before if it fits.
fn shared<T: Pod>(
    context: &Context,
    data: &GPUVec<T>,
    before: Option<Buffer>,
    missing: Error,
) -> Result<Buffer, Error> {
    match (data.data(), data.buffer()) {
        (Some(data), _) => {
            let mut buffer = before;
            Ok(fill(context, &mut buffer, bytemuck::cast_slice(data)))
        }
        (None, Some(own)) if own.usage().contains(BufferUsages::STORAGE) => Ok(own.clone()),
        _ => Err(missing),
    }
}

/// Writes what is of a frame, into a new buffer where there is too little room.
fn fill(context: &Context, buffer: &mut Option<Buffer>, bytes: &[u8]) -> Buffer {
    let needed = bytes.len() as u64;
    let fits = |buffer: &Buffer| buffer.size() >= needed && buffer.usage() == USAGE;
    let kept = buffer.take().filter(fits).unwrap_or_else(|| {
        // Nothing is bound that has no bytes: an instance's, at least.
        let size = needed.max(size_of::<Instance>() as u64);
        context.create_buffer_simple(Some("deep-screen-space-kiss3d"), size, USAGE)
    });
    context.write_buffer(&kept, 0, bytes);
    buffer.insert(kept).clone()
}

impl Drawn {
    /// `None` for what is not opaque: glass, what is blended, wireframes.
    pub fn new(object: usize, pose: Pose3, scale: Vec3, data: &ObjectData3d) -> Option<Self> {
        use kiss3d::scene::AlphaMode;
        let color = data.color();
        let blended = matches!(
            data.alpha_mode(),
            AlphaMode::Blend | AlphaMode::Premultiplied
        ) && color.a < 1.0;
        let opaque = data.surface_rendering_active() && !blended && data.transmission() <= 0.0;
        let rgb = |c: kiss3d::color::Color| Vec3::new(c.r, c.g, c.b);
        opaque.then(|| Self {
            object,
            pose: pose.to_mat4(),
            scale: Mat3::from_diagonal(scale),
            albedo: rgb(color) * (1.0 - data.metallic()).clamp(0.0, 1.0),
            // What is emitted is radiance in kiss3d, radiosity in the library.
            emission: rgb(data.emissive()) * std::f32::consts::PI,
            culls_backs: data.backface_culling_enabled(),
            map: Arc::clone(data.texture()),
        })
    }

    /// As kiss3d's vertex shader places them.
    fn instances(&self, adopted: &Adopted) -> Result<Vec<Instance>, Error> {
        let instances = adopted.instances.borrow();
        let object = self.object;
        let missing = || Error::Instances { object };
        let positions = instances.positions.data().as_ref().ok_or_else(missing)?;
        let columns = instances.deformations.data().as_ref().ok_or_else(missing)?;
        let colors = instances.colors.data().as_ref().ok_or_else(missing)?;
        let all = positions.iter().zip(columns.chunks_exact(3)).zip(colors);
        Ok(all
            .map(|((position, columns), color)| {
                let deformation = Mat3::from_cols(columns[0], columns[1], columns[2]);
                let transform = Mat4::from_translation(*position)
                    * self.pose
                    * Mat4::from_mat3(deformation * self.scale);
                let [r, g, b, _] = *color;
                Instance {
                    transform: transform.to_cols_array_2d(),
                    albedo: (self.albedo * Vec3::new(r, g, b)).extend(1.0).to_array(),
                }
            })
            .collect())
    }
}

impl Triangulation {
    /// Takes up what is drawn: all data that changed, and all transforms.
    pub fn update(
        &mut self,
        context: &Context,
        adopted: &mut [Adopted],
        drawn: &[Drawn],
    ) -> Result<(), Error> {
        let mut instances = Vec::new();
        let mut materials = vec![Material::default(); adopted.len().max(1)];
        self.ranges.clear();
        self.ranges.resize(adopted.len(), (0, 0));
        let mut is_drawn = vec![false; adopted.len()];
        for drawn in drawn {
            let object = drawn.object;
            let of_object = drawn.instances(&adopted[object])?;
            is_drawn[object] = true;
            self.ranges[object] = (instances.len() as u32, of_object.len() as u32);
            instances.extend(of_object);
            materials[object] = Material {
                albedo: drawn.albedo.to_array(),
                emission: drawn.emission.to_array(),
                double_sided: u32::from(!drawn.culls_backs),
                ..Material::default()
            };
        }
        for (object, (adopted, is_drawn)) in adopted.iter_mut().zip(is_drawn).enumerate() {
            if adopted.update(context, object, is_drawn)? {
                self.changed.push(object);
            }
        }
        fill(
            context,
            &mut self.instances,
            bytemuck::cast_slice(&instances),
        );
        fill(
            context,
            &mut self.materials,
            bytemuck::cast_slice(&materials),
        );
        Ok(())
    }

    /// The instances that an object has in this frame, in [`Triangulation::instances`].
    pub fn range(&self, object: usize) -> std::ops::Range<u32> {
        let (first, count) = self.ranges[object];
        first..first + count
    }

    /// Transforms and albedos.
    pub fn instances(&self) -> Option<&Buffer> {
        self.instances.as_ref()
    }

    /// The table that [`Mesh::material`] points into.
    pub fn materials(&self) -> Option<&Buffer> {
        self.materials.as_ref()
    }

    /// What is kept of objects, bytes; kiss3d's own buffers not counted.
    pub fn memory_bytes(&self, adopted: &[Adopted]) -> u64 {
        let own = |buffer: &&Buffer| buffer.usage() == USAGE;
        let meshes = adopted
            .iter()
            .filter_map(|adopted| adopted.triangles.as_ref());
        let meshes = meshes.flat_map(|t| [&t.positions, &t.indices]);
        let frame = [&self.instances, &self.materials].into_iter().flatten();
        meshes.chain(frame).filter(own).map(Buffer::size).sum()
    }

    /// The draws, one an object. One that is not drawn has no instances: so the others keep their places.
    pub fn meshes<'a>(&'a self, adopted: &'a [Adopted]) -> Vec<Mesh<'a>> {
        let Some(buffer) = &self.instances else {
            return Vec::new();
        };
        let all = adopted.iter().zip(&self.ranges).enumerate();
        all.filter_map(|(object, (adopted, &(first, count)))| {
            let triangles = adopted.triangles.as_ref()?;
            let stride = size_of::<Instance>() as u32;
            Some(Mesh {
                vertices: Vertices {
                    buffer: &triangles.positions,
                    offset: 0,
                    stride: 12,
                    format: PositionFormat::Float32x3,
                    count: triangles.vertices,
                },
                indices: Some(Indices {
                    buffer: &triangles.indices,
                    offset: 0,
                    format: IndexFormat::Uint32,
                }),
                first: 0,
                count: triangles.count,
                base_vertex: 0,
                instances: Some(Instances {
                    buffer,
                    offset: u64::from(first) * u64::from(stride),
                    stride,
                    format: TransformFormat::Mat4,
                    count,
                }),
                material: object as u32,
            })
        })
        .collect()
    }
}
