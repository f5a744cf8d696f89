//! A hierarchy of two levels: one per mesh, in its own space, and one over the instances of all meshes
//! (`wgsl/instanced_bvh.wgsl`).

pub(crate) mod params;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use wgpu::{Buffer, BufferUsages, CommandEncoder, ComputePass, ComputePipeline, Device};

use self::params::PlaceParams;
use crate::{
    alpha_test::{
        AlphaMaps, bound, check_window, create_cutouts,
        params::AlphaTestParams,
        settings::{AlphaTest, AlphaTests},
        window_of,
    },
    bvh::{
        Primitives,
        triangles::{BvhPass, NodePool, Over, Workspace},
    },
    camera::Camera,
    effect::Listing,
    error::{Error, check_limit, check_setting},
    geometry::{Geometry, Mesh},
    gpu::{
        Kernel, Timestamps, WORKGROUP,
        binding::{self, Group, Kept, Layout, Named, whole},
        check_timestamps,
        compiler::Compiler,
        compute_pass, dispatch, shader, storage,
        uniforms::{Parameters, Uniforms},
    },
    mesh_binding::{MeshBinding, Window, check_bound, windows},
    recorded::{Recordings, Stamp},
    surfel::{Piece, SurfelCounts},
};

const SOURCE: &str = include_str!("../../wgsl/instanced_bvh.wgsl");

const LABEL: &str = "deep-screen-space instanced bvh";

const NAME: &str = "InstancedBvh";

/// Bytes of the shader's `Instance`, and of an anchor.
pub(crate) const INSTANCE_BYTES: u64 = 96;
const ANCHOR_BYTES: u64 = 16;

crate::reflection::bytes_of_wgsl!(
    instances_are_the_shaders: INSTANCE_BYTES, as "Instance" in ["instanced_bvh"]
);

/// The least triangles that a workspace is made for: meshes of fewer share one. Each next one is for up to four times as many.
const SMALLEST: u32 = 256;

/// The most nodes and triangles: what is left to visit packs an index of 24 bits.
const MOST: u64 = 1 << 24;

/// Which meshes' vertices or indices are others than when an [`InstancedBvh`] was last recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ChangedMeshes<'a> {
    /// None: only transforms may be.
    #[default]
    None,
    /// Those of these indices into [`Geometry::meshes`].
    Some(&'a [usize]),
    /// All.
    All,
}

/// What one recording of the [`InstancedBvhBuilder`] works on.
#[derive(Clone, Copy, Debug)]
pub struct InstancedBvhInput<'a> {
    /// The caller's meshes, as many as the hierarchy was created for, in the same order.
    pub geometry: Geometry<'a>,
    /// Its [focus](Camera::focus) becomes the scene's origin.
    pub camera: &'a Camera,
    /// The meshes to be built anew. One that was never built is, in any case.
    pub changed: ChangedMeshes<'a>,
    /// Which triangles have holes, with [`Primitives::AlphaTestedInstances`]: none of them without. A mesh whose test is another
    /// than when it was built is built anew; one whose texture coordinates alone changed is to be among `changed`.
    pub alpha_tests: Option<AlphaTests<'a>>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> InstancedBvhInput<'a> {
    /// With nothing changed but transforms, without timestamps.
    pub fn new(geometry: Geometry<'a>, camera: &'a Camera) -> Self {
        Self {
            geometry,
            camera,
            changed: ChangedMeshes::None,
            alpha_tests: None,
            timestamps: None,
        }
    }
}

/// What a recording found, as it stands in [`InstancedBvh::counts`] once the GPU has run it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct InstancedCounts {
    /// Instances of meshes that have triangles.
    pub instances: u32,
    /// Those of them that are left out: of a transform that is not finite, that makes an axis shorter than 1e-15 or longer than
    /// 1e15, or whose axes, each divided by its length, span a volume of less than 1e-6; or beyond 1e18 units.
    pub left_out: u32,
}

crate::reflection::same_as_wgsl!(
    counts_are_the_shaders: InstancedCounts as "Counts" in ["instanced_bvh"]
    { instances, left_out }
);

/// A bounding volume hierarchy of two levels, which rays traverse: one over each mesh's triangles in the mesh's own space, kept
/// for as long as its vertices are what they were, and one over the instances of all, made anew with each recording (a bottom
/// and a top level, elsewhere). For scenes of many instances and static parts: memory and building go with the meshes, where a
/// [`Bvh`](crate::Bvh) has every triangle of every instance. Rays take somewhat longer where instances overlap.
///
/// An [`InstancedBvhBuilder`] makes it; a [`BouncedZBuffer`](crate::BouncedZBuffer) for
/// [`Primitives::Instances`](crate::Primitives::Instances) traces it.
///
/// A mesh is kept as precisely as its vertices are given, relative to its first one. A ray moved to a mesh's space is rounded to
/// 5e-7 of its distance and that of the mesh's first vertex from the origin, and what lies nearer to where it starts than that
/// is not met: a mesh that spans kilometres is better cut into parts.
#[derive(Debug)]
pub struct InstancedBvh {
    pool: NodePool,
    /// Where triangles may have holes.
    maps: Option<AlphaMaps>,
    meshes: Vec<MeshRoom>,
    /// By size, each for meshes of up to four times as many triangles as the one before.
    workshops: Vec<Workshop>,
    instance_capacity: u32,
    top: Workspace,
    instances: Buffer,
    instance_counters: Buffer,
    anchors: Buffer,
    counts: Buffer,
    origin: DVec3,
    recordings: Recordings,
    kept: Kept,
}

/// Where a mesh's hierarchy is.
#[derive(Debug)]
struct MeshRoom {
    triangles: u32,
    first_node: u32,
    first_triangle: u32,
    /// Which of the workshops builds it.
    workshop: usize,
    /// With which test it was built, if it was: all zero where it has no holes.
    built: Option<AlphaTestParams>,
}

/// What builds meshes of some size.
#[derive(Debug)]
struct Workshop {
    workspace: Workspace,
    pieces: Buffer,
    /// Where triangles may have holes.
    cutouts: Option<Buffer>,
    counters: Buffer,
    /// Of the stages, and of the meshes that were built last.
    kept: Kept,
    kept_meshes: Kept,
}

impl InstancedBvh {
    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        let workshops = self.workshops.iter();
        let workshops = workshops.map(|w| {
            let cutouts = w.cutouts.as_ref().map_or(0, Buffer::size);
            w.workspace.bytes() + w.pieces.size() + cutouts + w.counters.size()
        });
        let buffers = [
            &self.instances,
            &self.instance_counters,
            &self.anchors,
            &self.counts,
        ];
        self.pool.bytes()
            + self.top.bytes()
            + workshops.sum::<u64>()
            + buffers.iter().map(|b| b.size()).sum::<u64>()
    }

    /// The point, in world space, that rays are relative to: the [focus](Camera::focus) of the camera last recorded.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// A buffer of one [`InstancedCounts`] (usages `STORAGE | COPY_SRC`), for the caller to copy and read when it likes.
    pub fn counts(&self) -> &Buffer {
        &self.counts
    }

    /// Whether it has room for a geometry.
    pub(crate) fn has_room(&self, geometry: &Geometry<'_>) -> bool {
        let meshes = geometry.meshes;
        let instances: u64 = meshes.iter().map(|m| u64::from(m.instance_count())).sum();
        let fits = |(mesh, room): (&Mesh<'_>, &MeshRoom)| mesh.triangles() <= room.triangles;
        meshes.len() == self.meshes.len()
            && instances <= u64::from(self.instance_capacity)
            && meshes.iter().zip(&self.meshes).all(fits)
    }

    /// What it is over.
    fn primitives(&self) -> Primitives {
        match self.maps {
            None => Primitives::Instances,
            Some(_) => Primitives::AlphaTestedInstances,
        }
    }

    /// [`Error::Mismatch`] where it is over others.
    pub(crate) fn check_primitives(&self, needed: Primitives) -> Result<(), Error> {
        if self.primitives() == needed {
            return Ok(());
        }
        let named = |primitives: Primitives| format!("Primitives::{primitives:?}");
        Err(Error::Mismatch {
            name: NAME,
            found: named(self.primitives()),
            needed: named(needed),
        })
    }

    /// What a shader binds to trace it. [`Error::Mismatch`] where it was assembled for other primitives.
    pub(crate) fn traced(&self, primitives: Primitives) -> Result<Vec<Named<'_>>, Error> {
        self.check_primitives(primitives)?;
        let mut resources = vec![
            ("nodes", binding::view(&self.pool.nodes)),
            ("triangles", binding::view(&self.pool.triangles)),
        ];
        let maps = self.maps.as_ref();
        resources.extend(maps.map(|maps| ("alpha_maps", binding::view(maps.view()))));
        Ok(resources)
    }

    /// Its last recording, for what is recorded from it.
    pub(crate) fn last(&self) -> Result<Stamp, Error> {
        self.recordings.last(NAME)
    }

    /// [`Error::Recording`] for `name` where it was not recorded from this, since this was.
    pub(crate) fn check_source(&self, name: &'static str, stamp: &Stamp) -> Result<(), Error> {
        stamp.check(name, NAME, &self.recordings)
    }
}

/// Builds [`InstancedBvh`]s on the GPU: one [`InstancedBvhBuilder::record`] a frame.
///
/// Holds pipelines only; one serves any number of scenes.
#[derive(Debug)]
pub struct InstancedBvhBuilder {
    piece_layout: Layout,
    place_layout: Layout,
    make_pieces: ComputePipeline,
    place_instances: ComputePipeline,
    meshes: BvhPass,
    top: BvhPass,
    uniforms: Uniforms,
    alpha_tested: bool,
}

impl InstancedBvhBuilder {
    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device was made with less than that.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        Self::create_pipelines(compiler.into(), false)
    }

    /// The same for triangles of which some have holes: [`Primitives::AlphaTestedInstances`].
    ///
    /// # Errors
    /// As [`InstancedBvhBuilder::new`].
    pub fn alpha_tested<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        Self::create_pipelines(compiler.into(), true)
    }

    fn create_pipelines(compiler: Compiler<'_>, alpha_tested: bool) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler;
        check_limit(
            "max_storage_buffers_per_shader_stage",
            u64::from(device.limits().max_storage_buffers_per_shader_stage),
            if alpha_tested { 8 } else { 6 },
            LABEL,
        )?;
        let module = shader::create(device, LABEL, source(alpha_tested)?);
        let piece_layout = module.layout(device, &["make_pieces"]);
        let place_layout = module.layout(device, &["place_instances"]);
        let kernel = |entry, layout: &Layout| {
            Kernel {
                label: &format!("{LABEL}: {entry}"),
                module: &module,
                entry,
                layouts: &[&layout.raw],
                constants: &[],
                cache,
            }
            .create(device)
        };
        Ok(Self {
            make_pieces: kernel("make_pieces", &piece_layout),
            place_instances: kernel("place_instances", &place_layout),
            meshes: BvhPass::new(device, cache, over(alpha_tested))?,
            alpha_tested,
            top: BvhPass::new(device, cache, Over::Instances)?,
            uniforms: Uniforms::new(LABEL),
            piece_layout,
            place_layout,
        })
    }

    /// Room for a scene: for each mesh as many triangles, and in all as many instances, as `geometry` has. A geometry with more
    /// of either leaves room to grow.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device cannot hold or bind as much, with how much that is: bytes of a mesh's triangles or of
    /// the instances, or rows of a texture. Within `Limits::default()` a mesh may have 2 796 202 triangles, all of them
    /// 11 182 080, and there may be 1 398 101 instances. [`Error::Setting`] beyond 2²⁴ triangles or nodes, on any device.
    pub fn create(&self, device: &Device, geometry: &Geometry<'_>) -> Result<InstancedBvh, Error> {
        self.create_for(device, geometry, geometry.instances())
    }

    /// The same for so many instances.
    pub(crate) fn create_for(
        &self,
        device: &Device,
        geometry: &Geometry<'_>,
        instances: u32,
    ) -> Result<InstancedBvh, Error> {
        let limits = device.limits();
        let bytes = limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size);
        check_limit(
            "max_storage_buffer_binding_size",
            bytes,
            INSTANCE_BYTES * u64::from(instances),
            "instances of an InstancedBvh, 96 bytes each",
        )?;
        let mut nodes = u64::from(Over::Instances.most_nodes(instances));
        let mut triangles = 0_u64;
        let mut largest: Vec<u32> = Vec::new();
        let mut meshes = Vec::with_capacity(geometry.meshes.len());
        for mesh in geometry.meshes {
            let own = mesh.triangles();
            check_limit(
                "max_storage_buffer_binding_size",
                bytes,
                size_of::<Piece>() as u64 * u64::from(own),
                "triangles of a mesh of an InstancedBvh, 48 bytes each",
            )?;
            let workshop = workshop_for(own);
            meshes.push(MeshRoom {
                triangles: own,
                // What does not fit is refused below.
                first_node: nodes as u32,
                first_triangle: triangles as u32,
                workshop,
                built: None,
            });
            if own > 0 {
                largest.resize(largest.len().max(workshop + 1), 0);
                largest[workshop] = largest[workshop].max(own);
            }
            nodes += u64::from(over(self.alpha_tested).most_nodes(own));
            triangles += u64::from(own);
        }
        for (count, field) in [
            (nodes, "nodes of an InstancedBvh"),
            (triangles, "triangles of an InstancedBvh"),
        ] {
            check_setting(count <= MOST, field, count as f64, "up to 2^24")?;
        }
        let holes = over(self.alpha_tested);
        let pool = NodePool::new(device, holes, nodes as u32, triangles as u32)?;
        let counters = || {
            storage(
                device,
                "deep-screen-space counters of primitives",
                size_of::<SurfelCounts>() as u64,
                BufferUsages::COPY_DST,
            )
        };
        let workshops = largest.into_iter().map(|triangles| {
            Ok(Workshop {
                workspace: self.meshes.workspace(device, triangles.max(1))?,
                pieces: storage(
                    device,
                    "deep-screen-space triangles of a mesh",
                    size_of::<Piece>() as u64 * u64::from(triangles.max(1)),
                    BufferUsages::empty(),
                )?,
                cutouts: self
                    .alpha_tested
                    .then(|| create_cutouts(device, triangles))
                    .transpose()?,
                counters: counters()?,
                kept: Kept::default(),
                kept_meshes: Kept::default(),
            })
        });
        Ok(InstancedBvh {
            pool,
            maps: self.alpha_tested.then(|| AlphaMaps::none(device)),
            workshops: workshops.collect::<Result<_, Error>>()?,
            top: self.top.workspace(device, instances.max(1))?,
            instances: storage(
                device,
                "deep-screen-space instances",
                INSTANCE_BYTES * u64::from(instances.max(1)),
                BufferUsages::empty(),
            )?,
            instance_counters: counters()?,
            anchors: storage(
                device,
                "deep-screen-space origins of meshes",
                ANCHOR_BYTES * meshes.len() as u64,
                BufferUsages::empty(),
            )?,
            counts: storage(
                device,
                "deep-screen-space counts of instances",
                size_of::<InstancedCounts>() as u64,
                BufferUsages::COPY_SRC | BufferUsages::COPY_DST,
            )?,
            instance_capacity: instances,
            meshes,
            origin: DVec3::ZERO,
            recordings: Recordings::default(),
            kept: Kept::default(),
        })
    }

    /// Records the building into a compute pass of its own: of the meshes that changed or were never built, some 60 dispatches
    /// each and some 10 more for every factor of four in their triangles, and of the hierarchy over all instances, a dispatch a
    /// mesh and as many again as for one mesh.
    ///
    /// # Errors
    /// What [`Mesh::validate`] finds; [`Error::Limit`] for buffers that the device cannot bind; [`Error::Mismatch`] for another
    /// number of meshes, or more triangles or instances, than there is room for; [`Error::Setting`] for a changed mesh that
    /// there is none of; before anything is recorded.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &InstancedBvhInput<'_>,
        bvh: &mut InstancedBvh,
    ) -> Result<(), Error> {
        check_timestamps(input.timestamps)?;
        bvh.check(device, input)?;
        if bvh.maps.is_some() != self.alpha_tested {
            let needed = if self.alpha_tested {
                Primitives::AlphaTestedInstances
            } else {
                Primitives::Instances
            };
            return bvh.check_primitives(needed);
        }
        let origin = input.camera.focus();
        let mut parameters = Parameters::new(device);
        let mut drawn = Vec::with_capacity(bvh.meshes.len());
        let has_triangles = |mesh: &Mesh<'_>| mesh.triangles() > 0 && mesh.vertices.count > 0;
        let placed = input.geometry.meshes.iter().filter(|m| has_triangles(m));
        let instances = placed.map(Mesh::instance_count).sum();
        let mut first_instance = 0;
        for (index, mesh) in input.geometry.meshes.iter().enumerate() {
            if !has_triangles(mesh) {
                continue;
            }
            let binding = MeshBinding::new(mesh, 0);
            check_bound(device, &binding)?;
            let room = &bvh.meshes[index];
            let place = PlaceParams {
                first_node: room.first_node,
                first_triangle: room.first_triangle,
                mesh: index as u32,
                first_instance,
                instances,
                ..PlaceParams::new(origin)
            };
            first_instance += mesh.instance_count();
            let places = [
                ("mesh", parameters.add(&binding.params)),
                ("place", parameters.add(&place)),
            ];
            let holes = Holes::of(input.alpha_tests.as_ref(), index, mesh);
            let alpha = (self.alpha_tested).then(|| parameters.add(&holes.params));
            drawn.push((index, mesh, binding, places, (holes, alpha)));
        }

        bvh.recordings.advance();
        bvh.origin = origin;
        if let (Some(maps), Some(tests)) = (&mut bvh.maps, &input.alpha_tests) {
            maps.set(tests);
        }
        encoder.clear_buffer(&bvh.counts, 0, None);
        encoder.clear_buffer(&bvh.instance_counters, 0, None);
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let mut pass = compute_pass(encoder, LABEL, input.timestamps);
        // Those of a workshop follow each other.
        for at in 0..bvh.workshops.len() {
            let rooms = &bvh.meshes;
            let built = drawn.iter().filter(|(index, .., (holes, _))| {
                let room = &rooms[*index];
                let is_built = room.built == Some(holes.params);
                room.workshop == at && (!is_built || input.changed.has(*index))
            });
            let workshop = &bvh.workshops[at];
            let mut groups = workshop.kept_meshes.groups(device);
            let pieces: Vec<(u32, Group)> = built
                .map(|(_, mesh, binding, [params, place], (holes, alpha))| {
                    let [vertices, indices, _] = windows(mesh, binding);
                    let mut resources = vec![
                        (params.0, parameters.at(params.1)),
                        (place.0, parameters.at(place.1)),
                        ("vertices", vertices.clone()),
                        ("indices", indices),
                        ("counters", whole(&workshop.counters)),
                        ("state", whole(&workshop.workspace.state)),
                        ("pieces", whole(&workshop.pieces)),
                        ("anchors", whole(&bvh.anchors)),
                    ];
                    if let (Some(alpha), Some(cutouts)) = (alpha, &workshop.cutouts) {
                        let coords = holes.test.map(|(test, window)| bound(&test, window));
                        resources.extend([
                            ("alpha_test", parameters.at(*alpha)),
                            // A layout has no optional bindings: without a test these are never read.
                            ("tex_coords", coords.unwrap_or(vertices)),
                            ("cutouts", whole(cutouts)),
                        ]);
                    }
                    let group = groups.next(&self.piece_layout, &resources);
                    (mesh.triangles(), group)
                })
                .collect();
            drop(groups);
            if !pieces.is_empty() {
                self.build(device, &mut pass, workshop, &bvh.pool, &pieces);
            }
        }
        for (index, .., (holes, _)) in &drawn {
            bvh.meshes[*index].built = Some(holes.params);
        }

        let mut groups = bvh.kept.groups(device);
        for (_, mesh, binding, [params, place], _) in &drawn {
            let [_, _, transforms] = windows(mesh, binding);
            let resources = [
                (params.0, parameters.at(params.1)),
                (place.0, parameters.at(place.1)),
                ("transforms", transforms),
                ("counters", whole(&bvh.instance_counters)),
                ("state", whole(&bvh.top.state)),
                ("anchors", whole(&bvh.anchors)),
                ("nodes", binding::view(&bvh.pool.nodes)),
                ("instances", whole(&bvh.instances)),
                ("counts", whole(&bvh.counts)),
            ];
            let group = groups.next(&self.place_layout, &resources);
            let count = mesh.instance_count().div_ceil(WORKGROUP);
            dispatch(&mut pass, &self.place_instances, &group, count);
        }
        let primitives = ((&bvh.instances, &bvh.instance_counters), None);
        let stages = self.top.bind(&mut groups, &bvh.top, primitives, &bvh.pool);
        drop(groups);
        self.top.dispatch(&mut pass, &bvh.top, &stages);
        Ok(())
    }

    /// Builds meshes, of so many triangles each, one after the other.
    fn build(
        &self,
        device: &Device,
        pass: &mut ComputePass<'_>,
        workshop: &Workshop,
        pool: &NodePool,
        meshes: &[(u32, Group)],
    ) {
        let primitives = (&workshop.pieces, &workshop.counters);
        let primitives = (primitives, workshop.cutouts.as_ref());
        let mut groups = workshop.kept.groups(device);
        let stages = self
            .meshes
            .bind(&mut groups, &workshop.workspace, primitives, pool);
        drop(groups);
        for (triangles, group) in meshes {
            let count = triangles.div_ceil(WORKGROUP);
            dispatch(pass, &self.make_pieces, group, count);
            self.meshes.dispatch(pass, &workshop.workspace, &stages);
        }
    }
}

impl ChangedMeshes<'_> {
    fn has(self, mesh: usize) -> bool {
        match self {
            Self::None => false,
            Self::Some(meshes) => meshes.contains(&mesh),
            Self::All => true,
        }
    }
}

impl InstancedBvh {
    /// Checks that there is room for an input.
    fn check(&self, device: &Device, input: &InstancedBvhInput<'_>) -> Result<(), Error> {
        let meshes = input.geometry.meshes;
        if let Some(tests) = &input.alpha_tests {
            if self.maps.is_none() {
                return Err(Error::Mismatch {
                    name: "InstancedBvhInput::alpha_tests",
                    found: "triangles with holes".into(),
                    needed: "none, without Primitives::AlphaTestedInstances".into(),
                });
            }
            tests.validate(device, meshes)?;
        }
        let instances = meshes
            .iter()
            .map(|m| u64::from(m.instance_count()))
            .sum::<u64>();
        if meshes.len() != self.meshes.len() || instances > u64::from(self.instance_capacity) {
            return Err(Error::Mismatch {
                name: NAME,
                found: describe(self.meshes.len(), u64::from(self.instance_capacity)),
                needed: describe(meshes.len(), instances),
            });
        }
        for (index, (mesh, room)) in meshes.iter().zip(&self.meshes).enumerate() {
            mesh.validate()?;
            let used = [
                ("Mesh::vertices", Some(mesh.vertices.buffer)),
                ("Mesh::indices", mesh.indices.map(|i| i.buffer)),
                ("Mesh::instances", mesh.instances.map(|i| i.buffer)),
            ];
            for (name, buffer) in used {
                if let Some(buffer) = buffer {
                    binding::check_own(name, buffer, [&self.counts])?;
                }
            }
            if let Some(test) = input.alpha_tests.as_ref().and_then(|tests| tests.of(index)) {
                check_window(device, window_of(test, mesh.vertices.count))?;
            }
            if mesh.triangles() > room.triangles {
                return Err(Error::Mismatch {
                    name: NAME,
                    found: format!("{} triangles of mesh {index}", room.triangles),
                    needed: format!("{} triangles of mesh {index}", mesh.triangles()),
                });
            }
        }
        if let ChangedMeshes::Some(changed) = input.changed {
            for &mesh in changed {
                check_setting(
                    mesh < meshes.len(),
                    "InstancedBvhInput::changed",
                    mesh as f64,
                    "indices of the geometry's meshes",
                )?;
            }
        }
        Ok(())
    }
}

fn describe(meshes: usize, instances: u64) -> String {
    format!("{meshes} meshes, {instances} instances")
}

/// Which of the workshops builds a mesh of so many triangles.
fn workshop_for(triangles: u32) -> usize {
    let blocks = triangles.div_ceil(SMALLEST).max(1);
    // The least k for which 4^k blocks suffice.
    ((blocks - 1).checked_ilog2().map_or(0, |log| log + 1)).div_ceil(2) as usize
}

/// What a mesh's own hierarchy is over.
fn over(alpha_tested: bool) -> Over {
    if alpha_tested {
        Over::AlphaTested
    } else {
        Over::Triangles
    }
}

/// The holes of a mesh's triangles.
struct Holes<'a> {
    test: Option<(AlphaTest<'a>, Window)>,
    params: AlphaTestParams,
}

impl<'a> Holes<'a> {
    fn of(tests: Option<&AlphaTests<'a>>, index: usize, mesh: &Mesh<'_>) -> Self {
        let none = Self {
            test: None,
            params: AlphaTestParams::default(),
        };
        let Some((tests, test)) = tests.and_then(|tests| Some((tests, tests.of(index)?))) else {
            return none;
        };
        let window = window_of(test, mesh.vertices.count);
        Self {
            test: Some((*test, window)),
            params: AlphaTestParams::new(tests, test, window),
        }
    }
}

/// Assembles the module.
fn source(alpha_tested: bool) -> Result<String, Error> {
    let flags = over(alpha_tested).flags();
    shader::assemble("instanced_bvh", SOURCE, flags, &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add("instanced_bvh", source(false)?);
    all.add("instanced_bvh alpha tested", source(true)?);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::workshop_for;

    #[test]
    fn meshes_of_a_workshop_are_of_like_size() {
        for (triangles, workshop) in [
            (0, 0),
            (1, 0),
            (256, 0),
            (257, 1),
            (1024, 1),
            (1025, 2),
            (4096, 2),
            (4097, 3),
            (1 << 20, 6),
        ] {
            assert_eq!(workshop_for(triangles), workshop, "{triangles}");
        }
    }
}
