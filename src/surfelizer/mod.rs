//! Triangles to surfels, in compute (Deep Screen Space 3.1; The Bounced Z-buffer 4.3; `wgsl/surfelizer.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use wgpu::{CommandEncoder, ComputePipeline, Device};

use self::{
    params::{MAX_VIEWS, SurfelizerParams},
    settings::SurfelizerSettings,
};
use crate::{
    camera::Camera,
    effect::Listing,
    error::{Error, check_limit, check_setting},
    geometry::{Geometry, Mesh},
    gpu::compiler::Compiler,
    gpu::{
        Kernel, Timestamps, WORKGROUP,
        binding::{Layout, whole},
        check_timestamps, compute_pass, dispatch_rows,
        scan::Scan,
        shader,
        uniforms::{Parameters, Uniforms},
    },
    mesh_binding::{MeshBinding, check_bound, windows},
    surfel::{CloudCapacity, SurfelCloud},
};

const SOURCE: &str = include_str!("../../wgsl/surfelizer.wgsl");

const LABEL: &str = "deep-screen-space surfelizer";

/// Makes surfels of the caller's triangles: all of them, whether they are hidden, off screen, edge-on or behind the
/// camera, at a density that follows the distance from the eye.
///
/// Holds pipelines only; one serves any number of clouds.
#[derive(Debug)]
pub struct Surfelizer {
    cloud_layout: Layout,
    mesh_layout: Layout,
    finish_layout: Layout,
    surfel_layout: Layout,
    uniforms: Uniforms,
    count_pieces: ComputePipeline,
    merge_pieces: ComputePipeline,
    emit_pieces: ComputePipeline,
    finish: ComputePipeline,
    emit_surfels: ComputePipeline,
    scan: Scan,
}

/// What one recording of the [`Surfelizer`] works on.
#[derive(Clone, Copy, Debug)]
pub struct SurfelizerInput<'a> {
    /// The caller's triangles.
    pub geometry: Geometry<'a>,
    /// Decides the surfels' sizes; its [focus](Camera::focus) becomes the cloud's origin.
    pub camera: &'a Camera,
    /// Up to four views by which to leave out what cannot affect any of them, given
    /// [`SurfelizerSettings::reach`]; empty to keep all. Usually the camera itself; both eyes for stereo.
    pub cull_by: &'a [Camera],
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> SurfelizerInput<'a> {
    /// All triangles, of whatever view, without timestamps.
    pub fn new(geometry: Geometry<'a>, camera: &'a Camera) -> Self {
        Self {
            geometry,
            camera,
            cull_by: &[],
            timestamps: None,
        }
    }
}

impl Surfelizer {
    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device was made with less than that.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        check_limit(
            "max_storage_buffers_per_shader_stage",
            u64::from(device.limits().max_storage_buffers_per_shader_stage),
            8,
            LABEL,
        )?;
        let module = shader::create(
            device,
            LABEL,
            shader::assemble("surfelizer", SOURCE, &[], &[])?,
        );
        let of_meshes = ["count_pieces", "merge_pieces", "emit_pieces"];
        let of_surfels = ["finish", "emit_surfels"];
        let cloud_layout = module.layout(device, &[&of_meshes[..], &of_surfels].concat());
        let mesh_layout = module.layout_of(device, 1, &of_meshes);
        let finish_layout = module.layout_of(device, 1, &["finish"]);
        let surfel_layout = module.layout_of(device, 1, &["emit_surfels"]);
        let kernel = |entry, own: &Layout| {
            Kernel {
                label: &format!("{LABEL}: {entry}"),
                module: &module,
                entry,
                layouts: &[&cloud_layout.raw, &own.raw],
                constants: &[],
                cache,
            }
            .create(device)
        };
        Ok(Self {
            count_pieces: kernel("count_pieces", &mesh_layout),
            merge_pieces: kernel("merge_pieces", &mesh_layout),
            emit_pieces: kernel("emit_pieces", &mesh_layout),
            finish: kernel("finish", &finish_layout),
            emit_surfels: kernel("emit_surfels", &surfel_layout),
            scan: Scan::new(device, cache)?,
            uniforms: Uniforms::new(LABEL),
            cloud_layout,
            mesh_layout,
            finish_layout,
            surfel_layout,
        })
    }

    /// Room for the surfels of a scene.
    ///
    /// # Errors
    /// [`Error::Setting`] for a capacity out of range, [`Error::Limit`] where the device cannot bind as much.
    pub fn create_cloud(
        &self,
        device: &Device,
        capacity: CloudCapacity,
    ) -> Result<SurfelCloud, Error> {
        SurfelCloud::new(device, &self.scan, capacity)
    }

    /// Records the making of a cloud. What the cloud held is gone once the GPU runs it.
    ///
    /// # Errors
    /// [`Error::Setting`] or [`Error::Buffer`], before anything is recorded.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SurfelizerInput<'_>,
        settings: &SurfelizerSettings,
        cloud: &mut SurfelCloud,
    ) -> Result<(), Error> {
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        check_setting(
            input.cull_by.len() <= MAX_VIEWS,
            "SurfelizerInput::cull_by",
            input.cull_by.len() as f64,
            "at most 4 views",
        )?;
        let meshes = input.geometry.meshes;
        for mesh in meshes {
            mesh.validate()?;
            check_apart(mesh, cloud)?;
        }
        check_setting(
            input.geometry.triangles() <= cloud.capacity.triangles,
            "CloudCapacity::triangles",
            cloud.capacity.triangles,
            "at least the geometry's triangles, over all instances",
        )?;
        let mut first_triangle = 0;
        let mut without_vertices = 0;
        let mut bound = Vec::with_capacity(meshes.len());
        let mut parameters = Parameters::new(device);
        for mesh in meshes {
            let triangles = mesh.triangles() * mesh.instance_count();
            if mesh.vertices.count == 0 {
                without_vertices += triangles;
            } else if triangles > 0 {
                let binding = MeshBinding::new(mesh, first_triangle);
                check_bound(device, &binding)?;
                let place = parameters.add(&binding.params);
                bound.push((mesh, binding, place, triangles.div_ceil(WORKGROUP)));
            }
            first_triangle += triangles;
        }

        let params = SurfelizerParams::new(
            settings,
            input.camera,
            input.cull_by,
            cloud.capacity,
            without_vertices,
        );
        let params = parameters.add(&params);
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let mut groups = cloud.kept.groups(device);
        let resources = [
            ("params", parameters.at(params)),
            ("pieces", whole(&cloud.pieces)),
            ("piece_offsets", whole(&cloud.piece_offsets.values)),
            ("counters", whole(&cloud.counters)),
            ("tally", whole(&cloud.tally)),
        ];
        let cloud_group = groups.next(&self.cloud_layout, &resources);
        let resources = [("emission", whole(&cloud.emission))];
        let finish_group = groups.next(&self.finish_layout, &resources);
        let resources = [
            ("surfels", whole(&cloud.surfels)),
            ("sources", whole(&cloud.sources)),
        ];
        let surfel_group = groups.next(&self.surfel_layout, &resources);
        let draws: Vec<_> = bound
            .iter()
            .map(|(mesh, binding, place, workgroups)| {
                let [vertices, indices, transforms] = windows(mesh, binding);
                let resources = [
                    ("mesh", parameters.at(*place)),
                    ("vertices", vertices),
                    ("indices", indices),
                    ("transforms", transforms),
                    ("triangle_offsets", whole(&cloud.triangle_offsets.values)),
                ];
                (groups.next(&self.mesh_layout, &resources), *workgroups)
            })
            .collect();
        drop(groups);

        cloud.recordings.advance();
        cloud.origin = input.camera.focus();
        cloud.fits_holes = false;
        cloud.placement = settings.placement;
        cloud.perspective = input.camera.is_perspective();
        encoder.clear_buffer(&cloud.counters, 0, None);
        encoder.clear_buffer(&cloud.tally, 0, None);
        encoder.clear_buffer(&cloud.triangle_offsets.values, 0, None);
        encoder.clear_buffer(&cloud.piece_offsets.values, 0, None);
        let mut pass = compute_pass(encoder, LABEL, input.timestamps);
        let each_mesh = |pass: &mut wgpu::ComputePass<'_>, pipeline| {
            pass.set_pipeline(pipeline);
            for (group, groups) in &draws {
                let [x, y, z] = dispatch_rows(*groups);
                pass.set_bind_group(0, &cloud_group.raw, &cloud_group.offsets);
                pass.set_bind_group(1, &group.raw, &group.offsets);
                pass.dispatch_workgroups(x, y, z);
            }
        };
        each_mesh(&mut pass, &self.count_pieces);
        each_mesh(&mut pass, &self.merge_pieces);
        self.scan.record(&mut pass, &cloud.triangle_offsets);
        each_mesh(&mut pass, &self.emit_pieces);
        self.scan.record(&mut pass, &cloud.piece_offsets);
        pass.set_bind_group(0, &cloud_group.raw, &cloud_group.offsets);
        pass.set_bind_group(1, &finish_group.raw, &[]);
        pass.set_pipeline(&self.finish);
        pass.dispatch_workgroups(1, 1, 1);
        pass.set_pipeline(&self.emit_surfels);
        pass.set_bind_group(1, &surfel_group.raw, &[]);
        pass.dispatch_workgroups_indirect(&cloud.emission, 0);
        Ok(())
    }
}

/// A kernel cannot read what it writes: refuses a mesh made of the cloud's own buffers.
fn check_apart(mesh: &Mesh<'_>, cloud: &SurfelCloud) -> Result<(), Error> {
    let own = [&cloud.pieces, &cloud.counters];
    for (name, buffer) in [
        ("Mesh::vertices", Some(mesh.vertices.buffer)),
        ("Mesh::indices", mesh.indices.map(|i| i.buffer)),
        ("Mesh::instances", mesh.instances.map(|i| i.buffer)),
    ] {
        if buffer.is_some_and(|b| own.contains(&b)) {
            return Err(Error::Buffer {
                name,
                found: "a buffer of the cloud that is recorded".into(),
                needed: "a buffer of its own".into(),
            });
        }
    }
    Ok(())
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add(
        "surfelizer",
        shader::assemble("surfelizer", SOURCE, &[], &[])?,
    );
    Ok(())
}
