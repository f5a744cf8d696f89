//! Surfels of alpha-tested triangles, made to fit what is there of them (`wgsl/surfel_holes.wgsl`).

mod params;

use wgpu::{Buffer, CommandEncoder, ComputePipeline, Device};

use self::params::SurfelHolesParams;
use crate::{
    alpha_test::{AlphaMaps, AlphaTestPass, create_cutouts, settings::AlphaTests},
    effect::Listing,
    error::Error,
    geometry::Geometry,
    gpu::{
        Timestamps,
        binding::{Kept, Layout, view, whole},
        check_timestamps,
        compiler::Compiler,
        compute_pass, shader,
        uniforms::Uniforms,
    },
    surfel::SurfelCloud,
};

const SOURCE: &str = include_str!("../../wgsl/surfel_holes.wgsl");

const LABEL: &str = "deep-screen-space surfel holes";

/// Makes the surfels of alpha-tested triangles, foliage and fences, as large as what is there of them: record it after the
/// [`Surfelizer`](crate::Surfelizer) and before all that reads the cloud. A surfel of which nothing is there has radius 0, and
/// affects nothing.
///
/// Splatted effects then see the holes, in the mean over a surfel's area. Pieces stay whole: rays ask
/// [`Primitives::AlphaTested`](crate::Primitives::AlphaTested) for holes of their own.
///
/// Holds pipelines only; one serves any number of clouds.
#[derive(Debug)]
pub struct SurfelHoles {
    alpha_test: AlphaTestPass,
    layout: Layout,
    fit_surfels: ComputePipeline,
    uniforms: Uniforms,
}

/// The holes of a cloud's pieces, 32 bytes for each that there is room for.
#[derive(Debug)]
pub struct SurfelCutouts {
    pieces: u32,
    cutouts: Buffer,
    maps: AlphaMaps,
    /// Of the recording: with the buffers of meshes, and without.
    kept: [Kept; 2],
}

/// What one recording of [`SurfelHoles`] works on.
#[derive(Clone, Copy, Debug)]
pub struct SurfelHolesInput<'a> {
    /// What the cloud was made of: the geometry of its recording, whose buffers are read once more.
    pub geometry: Geometry<'a>,
    /// Which of it has holes.
    pub tests: AlphaTests<'a>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl SurfelCutouts {
    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        self.cutouts.size()
    }
}

impl SurfelHoles {
    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// None today.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        let module = shader::create(device, LABEL, source()?);
        let (layout, fit_surfels) = module.kernel(device, "fit_surfels", &[], cache);
        Ok(Self {
            alpha_test: AlphaTestPass::new(device, cache)?,
            layout,
            fit_surfels,
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Room for the holes of a cloud's pieces.
    ///
    /// # Errors
    /// [`Error::Limit`] where the device cannot bind as much.
    pub fn create_cutouts(
        &self,
        device: &Device,
        cloud: &SurfelCloud,
    ) -> Result<SurfelCutouts, Error> {
        let pieces = cloud.capacity.pieces;
        Ok(SurfelCutouts {
            pieces,
            cutouts: create_cutouts(device, pieces)?,
            maps: AlphaMaps::none(device),
            kept: Default::default(),
        })
    }

    /// Records the fitting of a cloud's surfels. What was recorded from the cloud before is out of date.
    ///
    /// # Errors
    /// Before anything is recorded: [`Error::Recording`] for a cloud that was not recorded, or whose surfels fit since it was;
    /// [`Error::Mismatch`] for room of a cloud with another capacity, or a geometry of more triangles than the cloud has room
    /// for; what [`AlphaTests::validate`] and [`Mesh::validate`](crate::Mesh::validate) find; [`Error::Limit`] for buffers that
    /// the device cannot bind.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &SurfelHolesInput<'_>,
        cutouts: &mut SurfelCutouts,
        cloud: &mut SurfelCloud,
    ) -> Result<(), Error> {
        check_timestamps(input.timestamps)?;
        cloud.last()?;
        if cloud.fits_holes {
            return Err(Error::Recording {
                name: "SurfelCloud",
                found: "fitted to its holes since it was last recorded".into(),
            });
        }
        if cutouts.pieces != cloud.capacity.pieces {
            return Err(Error::Mismatch {
                name: "SurfelCutouts",
                found: format!("room for {} pieces", cutouts.pieces),
                needed: format!("{}, as the cloud has", cloud.capacity.pieces),
            });
        }
        let (geometry, tests) = (&input.geometry, &input.tests);
        AlphaTestPass::check(device, "SurfelHolesInput::geometry", geometry, tests, cloud)?;
        cutouts.maps.set(tests);
        let [of_meshes, of_surfels] = &cutouts.kept;
        let own = (&cutouts.cutouts, of_meshes);
        let cuts = self
            .alpha_test
            .bind(device, encoder, (geometry, tests), cloud, own);
        let params = SurfelHolesParams::new(cloud.placement);
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        let resources = [
            ("params", parameters.at(params)),
            ("counters", whole(&cloud.counters)),
            ("pieces", whole(&cloud.pieces)),
            ("cutouts", whole(&cutouts.cutouts)),
            ("sources", whole(&cloud.sources)),
            ("surfels", whole(&cloud.surfels)),
            ("alpha_maps", view(cutouts.maps.view())),
        ];
        let group = of_surfels.groups(device).next(&self.layout, &resources);
        encoder.clear_buffer(&cutouts.cutouts, 0, None);
        let mut pass = compute_pass(encoder, LABEL, input.timestamps);
        self.alpha_test.dispatch(&mut pass, &cuts);
        pass.set_pipeline(&self.fit_surfels);
        pass.set_bind_group(0, &group.raw, &group.offsets);
        pass.dispatch_workgroups_indirect(&cloud.emission, 0);
        drop(pass);
        cloud.recordings.advance();
        cloud.fits_holes = true;
        Ok(())
    }
}

/// Assembles the module.
fn source() -> Result<String, Error> {
    shader::assemble("surfel_holes", SOURCE, &[], &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add("surfel_holes", source()?);
    Ok(())
}
