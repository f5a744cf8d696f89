//! Bevy's meshes as the library's triangles: vertices and indices where they stand in Bevy's slabs, transforms anew each frame.

use bevy::{
    asset::{AssetId, Assets},
    camera::visibility::{InheritedVisibility, RenderLayers, VisibilityRange, VisibleEntityRanges},
    ecs::{
        entity::Entity,
        query::{Has, Without},
        resource::Resource,
        system::{Query, Res, ResMut},
    },
    light::NotShadowCaster,
    material::AlphaMode,
    math::Affine3A,
    mesh::{Mesh, Mesh3d, PrimitiveTopology, skinning::SkinnedMesh},
    pbr::{Material, MeshMaterial3d},
    platform::collections::{HashMap, HashSet},
    render::{
        Extract,
        mesh::{RenderMesh, RenderMeshBufferInfo, allocator::MeshAllocator},
        render_asset::{ExtractedAssets, RenderAssets},
        renderer::{RenderDevice, RenderQueue},
    },
    transform::components::GlobalTransform,
};
use deep_screen_space::{
    IndexFormat, Indices, Instances, PositionFormat, TransformFormat, Vertices,
};
use wgpu::{Buffer, BufferDescriptor, BufferUsages};

use crate::error::Error;

/// The upper rows of an instance's transform.
type Rows = [[f32; 4]; 3];

/// What rays may meet, as the application has it in this frame.
#[derive(Resource, Default)]
pub struct Occluders {
    /// Those that are drawn with the effect.
    cameras: Vec<Entity>,
    meshes: Vec<(AssetId<Mesh>, Affine3A)>,
}

impl Occluders {
    /// Begins a frame.
    pub fn clear(&mut self) {
        self.cameras.clear();
        self.meshes.clear();
    }

    /// Takes up a camera that is drawn with the effect.
    pub fn add_camera(&mut self, camera: Entity) {
        self.cameras.push(camera);
    }
}

/// Takes up what is visible to a camera, off its screen too, once the cameras are.
pub fn extract_occluders<M: Material>(
    mut occluders: ResMut<Occluders>,
    layers: Extract<Query<&RenderLayers>>,
    meshes: Extract<
        Query<
            (
                Entity,
                &Mesh3d,
                &GlobalTransform,
                &InheritedVisibility,
                &MeshMaterial3d<M>,
                Option<&RenderLayers>,
                Has<VisibilityRange>,
            ),
            (Without<NotShadowCaster>, Without<SkinnedMesh>),
        >,
    >,
    materials: Extract<Option<Res<Assets<M>>>>,
    ranges: Extract<Res<VisibleEntityRanges>>,
) {
    let Occluders {
        cameras,
        meshes: taken,
    } = &mut *occluders;
    let Some(materials) = &*materials else {
        return;
    };
    if cameras.is_empty() || !M::enable_prepass() {
        return;
    }
    for (entity, mesh, transform, visibility, material, of_mesh, has_range) in &meshes {
        let of_mesh = of_mesh.unwrap_or_default();
        let is_seen = visibility.get()
            && cameras.iter().any(|&camera| {
                let of_camera = layers.get(camera).ok().unwrap_or_default();
                of_camera.intersects(of_mesh)
                    && (!has_range || ranges.entity_is_in_range_of_view(entity, camera))
            });
        if is_seen && materials.get(&material.0).is_some_and(is_opaque) {
            taken.push((mesh.id(), transform.affine()));
        }
    }
}

/// Whether a material is in Bevy's prepass, from which rays start.
fn is_opaque(material: &impl Material) -> bool {
    matches!(
        material.alpha_mode(),
        AlphaMode::Opaque | AlphaMode::Mask(_) | AlphaMode::AlphaToCoverage
    ) && !material.reads_view_transmission_texture()
}

/// All triangles of a frame.
#[derive(Resource, Default)]
pub struct Triangles {
    meshes: Vec<Placed>,
    /// Transforms of all instances, those of a mesh beside each other.
    instances: Option<Buffer>,
    /// Meshes whose vertices came since the last recording.
    uploaded: HashSet<AssetId<Mesh>>,
    /// Which meshes the last recording was of, in their order, unless it failed.
    recorded: Option<Vec<AssetId<Mesh>>>,
}

/// A mesh, and where it is in this frame, if anywhere.
struct Placed {
    asset: AssetId<Mesh>,
    /// How many vertices and corners it has.
    counts: [u32; 2],
    transforms: Vec<Rows>,
}

/// Takes up what changed, and all transforms.
pub fn update_triangles(
    mut triangles: ResMut<Triangles>,
    occluders: Res<Occluders>,
    uploads: Res<ExtractedAssets<RenderMesh>>,
    assets: Res<RenderAssets<RenderMesh>>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    if occluders.cameras.is_empty() {
        // Nothing is recorded, and all is when there is a camera again.
        *triangles = Triangles::default();
        return;
    }
    let Triangles {
        meshes,
        instances,
        uploaded,
        recorded,
    } = &mut *triangles;
    uploaded.extend(uploads.added.union(&uploads.modified));

    // A mesh that is hidden keeps its place, and one that is no more loses it.
    meshes.retain(|mesh| assets.get(mesh.asset).is_some());
    for mesh in &mut *meshes {
        mesh.transforms.clear();
    }
    let places = meshes.iter().enumerate();
    let mut places: HashMap<_, _> = places.map(|(place, mesh)| (mesh.asset, place)).collect();
    for &(asset, transform) in &occluders.meshes {
        if !assets.get(asset).is_some_and(has_surface) {
            continue;
        }
        let place = *places.entry(asset).or_insert_with(|| {
            meshes.push(Placed {
                asset,
                counts: [0; 2],
                transforms: Vec::new(),
            });
            meshes.len() - 1
        });
        meshes[place].transforms.push(rows(&transform));
    }

    // Where all are built anyway hidden ones are not: that one of them was refused must not outlast its being seen.
    if recorded.is_none() {
        meshes.retain(|mesh| !mesh.transforms.is_empty());
    }

    // Where Bevy puts uploads off, a mesh's data may arrive before its counts do.
    for mesh in &mut *meshes {
        let now = assets.get(mesh.asset).map_or([0; 2], counts);
        if mesh.counts != now {
            mesh.counts = now;
            uploaded.insert(mesh.asset);
        }
    }

    let all: Vec<Rows> = meshes
        .iter()
        .flat_map(|mesh| &mesh.transforms)
        .copied()
        .collect();
    let bytes: &[u8] = bytemuck::cast_slice(&all);
    if bytes.is_empty() {
        return;
    }
    let size = bytes.len() as u64;
    let buffer = match instances.take_if(|buffer| buffer.size() >= size) {
        Some(buffer) => buffer,
        // A quarter more than there are, for a scene that grows.
        None => device.wgpu_device().create_buffer(&BufferDescriptor {
            label: Some("deep-screen-space-bevy instances"),
            size: (size + size / 4).next_multiple_of(4),
            usage: BufferUsages::STORAGE | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        }),
    };
    queue.write_buffer(&buffer, 0, bytes);
    *instances = Some(buffer);
}

/// Whether a mesh is one of triangles, as its buffers have it: morphed ones are elsewhere.
fn has_surface(mesh: &RenderMesh) -> bool {
    let topology = mesh.primitive_topology();
    let is_surface = matches!(
        topology,
        PrimitiveTopology::TriangleList | PrimitiveTopology::TriangleStrip
    );
    is_surface && !mesh.has_morph_targets()
}

fn counts(mesh: &RenderMesh) -> [u32; 2] {
    let corners = match mesh.buffer_info {
        RenderMeshBufferInfo::Indexed { count, .. } => count,
        RenderMeshBufferInfo::NonIndexed => mesh.vertex_count,
    };
    [mesh.vertex_count, corners]
}

fn rows(transform: &Affine3A) -> Rows {
    let [x, y, z, w] = [
        transform.matrix3.x_axis,
        transform.matrix3.y_axis,
        transform.matrix3.z_axis,
        transform.translation,
    ]
    .map(|axis| axis.to_array());
    [0, 1, 2].map(|row| [x[row], y[row], z[row], w[row]])
}

impl Triangles {
    /// The draws, one a mesh, in the order of the assets that they are of.
    pub fn meshes<'a>(
        &'a self,
        assets: &RenderAssets<RenderMesh>,
        allocator: &'a MeshAllocator,
    ) -> Result<(Vec<AssetId<Mesh>>, Vec<deep_screen_space::Mesh<'a>>), Error> {
        let mut drawn = (Vec::new(), Vec::new());
        let Some(buffer) = &self.instances else {
            return Ok(drawn);
        };
        let stride = size_of::<Rows>() as u32;
        let mut offset = 0;
        for Placed {
            asset, transforms, ..
        } in &self.meshes
        {
            let instances = Instances {
                buffer,
                offset,
                stride,
                format: TransformFormat::Rows3x4,
                count: transforms.len() as u32,
            };
            offset += u64::from(stride) * u64::from(instances.count);
            let Some(mesh) = assets.get(*asset) else {
                continue;
            };
            match of_slabs(*asset, mesh, allocator, instances) {
                Ok(Some(mesh)) => {
                    drawn.0.push(*asset);
                    drawn.1.push(mesh);
                }
                Ok(None) => {}
                // Of no account where nobody sees it.
                Err(_) if transforms.is_empty() => {}
                Err(error) => return Err(error),
            }
        }
        Ok(drawn)
    }

    /// Places among the draws' assets of those to be built: `None` for all, as they are others than in the last recording.
    pub fn changed(&self, assets: &[AssetId<Mesh>]) -> Option<Vec<usize>> {
        let is_uploaded = |place: &usize| self.uploaded.contains(&assets[*place]);
        let are_same = self.recorded.as_deref() == Some(assets);
        are_same.then(|| (0..assets.len()).filter(is_uploaded).collect())
    }

    /// Notes what was recorded, if it was.
    pub fn note(&mut self, recorded: Option<Vec<AssetId<Mesh>>>) {
        self.recorded = recorded;
        self.uploaded.clear();
    }
}

/// A mesh in Bevy's buffers, if it has arrived there.
fn of_slabs<'a>(
    asset: AssetId<Mesh>,
    mesh: &RenderMesh,
    allocator: &'a MeshAllocator,
    instances: Instances<'a>,
) -> Result<Option<deep_screen_space::Mesh<'a>>, Error> {
    let named = || format!("{asset}");
    if mesh.primitive_topology() != PrimitiveTopology::TriangleList {
        return Err(Error::Topology {
            mesh: named(),
            topology: "a strip",
        });
    }
    let layout = &mesh.layout.0;
    let position = Mesh::ATTRIBUTE_POSITION.id;
    let position = layout.attribute_ids().iter().position(|&id| id == position);
    let position = position.and_then(|place| layout.layout().attributes.get(place));
    let (Some(position), Some(vertices)) = (position, allocator.mesh_vertex_slice(&asset)) else {
        return Ok(None);
    };
    let format = PositionFormat::try_from(position.format).map_err(|error| Error::Mesh {
        mesh: named(),
        error,
    })?;
    let stride = layout.layout().array_stride;
    let [vertex_count, count] = counts(mesh);
    let indices = match mesh.index_format() {
        None => None,
        Some(format) => {
            let Some(slice) = allocator.mesh_index_slice(&asset) else {
                return Ok(None);
            };
            Some(Indices {
                buffer: slice.buffer,
                offset: u64::from(slice.range.start) * u64::from(format.byte_size()),
                format: IndexFormat::from(format),
            })
        }
    };
    Ok(Some(deep_screen_space::Mesh {
        vertices: Vertices {
            buffer: vertices.buffer,
            offset: u64::from(vertices.range.start) * stride + position.offset,
            stride: stride as u32,
            format,
            count: vertex_count,
        },
        indices,
        first: 0,
        count,
        base_vertex: 0,
        instances: Some(instances),
        material: 0,
    }))
}
