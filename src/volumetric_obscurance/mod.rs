//! The share of the space about a point that lies in front of the depth buffer (Loos and Sloan, *Volumetric Obscurance*, 2010;
//! `wgsl/volumetric_obscurance.wgsl`).

pub(crate) mod params;
pub(crate) mod samples;
pub(crate) mod settings;

use wgpu::{CommandEncoder, Device, TextureFormat, TextureUsages};

use self::{
    params::ObscuranceParams,
    settings::{ObscuranceSampling, ObscuranceSettings, ObscuranceVolume},
};
use crate::{
    camera::Camera,
    depth_moments::{DepthMoments, DepthMomentsPass},
    effect::Listing,
    error::Error,
    gbuffer::{Normals, check_depth},
    gpu::compiler::Compiler,
    gpu::listing::name_of,
    gpu::{
        Timestamps,
        binding::{view, whole},
        check_timestamps, shader,
        uniforms::Uniforms,
    },
    texture_slice::{TextureSlice, check_apart},
    work::{PixelList, WorkKernel, WorkKernelDescriptor, check_work},
};

const SOURCE: &str = include_str!("../../wgsl/volumetric_obscurance.wgsl");

const LABEL: &str = "deep-screen-space volumetric obscurance";

/// The only format of its targets.
const TARGET: TextureFormat = TextureFormat::R32Float;

/// What a [`VolumetricObscurance`] is made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VolumetricObscuranceDescriptor {
    /// How to integrate.
    pub sampling: ObscuranceSampling,
    /// Over what.
    pub volume: ObscuranceVolume,
}

/// Obscurance from a depth buffer, with or without normals: near-field detail, at a few reads per pixel.
///
/// For each pixel the share of a sphere of a constant radius in the world that is open, which is to say in front of what the
/// depth buffer shows. The sphere is cut into chords along the line from the pixel's point to the eye, as if lines of sight
/// through it were parallel: the error of that is about the sphere's radius over its distance, which
/// [`ObscuranceSettings::max_pixels`] bounds. What is seen outside of the viewport is unknown: such samples do
/// not count. The sky is open.
///
/// Noisy, since each pixel has samples of its own: meant to be smoothed, by
/// [`TemporalAccumulator`](crate::TemporalAccumulator) for instance, except for [`ObscuranceSampling::OneArea`].
///
/// ```no_run
/// use deep_screen_space::*;
///
/// /// Obscurance of what a depth texture shows within half a unit, into an `R32Float` texture of usage `STORAGE_BINDING`.
/// fn obscure(
///     device: &wgpu::Device,
///     encoder: &mut wgpu::CommandEncoder,
///     depth: &wgpu::Texture,
///     camera: &Camera,
///     target: &wgpu::Texture,
/// ) -> Result<(), Error> {
///     // Once.
///     let descriptor = VolumetricObscuranceDescriptor {
///         sampling: ObscuranceSampling::Lines(DiskSamples::Nine),
///         volume: ObscuranceVolume::Sphere,
///     };
///     let obscurance = VolumetricObscurance::new(device, &descriptor)?;
///
///     // Every frame.
///     let settings = ObscuranceSettings { radius: 0.5, ..ObscuranceSettings::default() };
///     obscurance.record(device, encoder, &ObscuranceInput::new(depth, camera, target), &settings)
/// }
/// ```
///
/// Holds pipelines only; one serves any number of views.
#[derive(Debug)]
pub struct VolumetricObscurance {
    sampling: ObscuranceSampling,
    volume: ObscuranceVolume,
    moments: Option<DepthMomentsPass>,
    kernel: WorkKernel,
    uniforms: Uniforms,
}

/// What one recording of a [`VolumetricObscurance`] works on.
#[derive(Clone, Copy, Debug)]
pub struct ObscuranceInput<'a> {
    /// Depth, as [`GBuffer::depth`](crate::GBuffer::depth).
    pub depth: TextureSlice<'a>,
    /// Normals ([`GBuffer::normals`](crate::GBuffer::normals)); [`ObscuranceVolume::Sphere`] reads none, the others need them.
    pub normals: Option<Normals<'a>>,
    /// The camera of both.
    pub camera: &'a Camera,
    /// The depth's moments, recorded for this frame; area samples alone read them, and need them.
    pub moments: Option<&'a DepthMoments>,
    /// The pixels to compute; all, if left out.
    pub work: Option<PixelList<'a>>,
    /// Where to write the open share, 0…1 with 1 for open, sky among it: `R32Float`, usage `STORAGE_BINDING`, at least of the
    /// viewport's size (that of the work list's level), from the corner. Pixels that are not computed stay.
    pub target: TextureSlice<'a>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> ObscuranceInput<'a> {
    /// Over whole spheres, from depth alone, at all pixels, without timestamps.
    pub fn new(
        depth: impl Into<TextureSlice<'a>>,
        camera: &'a Camera,
        target: impl Into<TextureSlice<'a>>,
    ) -> Self {
        Self {
            depth: depth.into(),
            camera,
            target: target.into(),
            normals: None,
            moments: None,
            work: None,
            timestamps: None,
        }
    }
}

impl VolumetricObscurance {
    /// Compiles the pipelines.
    ///
    /// # Errors
    /// None today; shaders are assembled as the caller's effects are.
    pub fn new<'a>(
        compiler: impl Into<Compiler<'a>>,
        descriptor: &VolumetricObscuranceDescriptor,
    ) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        let &VolumetricObscuranceDescriptor { sampling, volume } = descriptor;
        let variant = |list: bool| ObscuranceVariant::new(sampling, volume, list);
        let flag = |on: bool| f64::from(u8::from(on));
        let points = matches!(sampling, ObscuranceSampling::Points(_));
        let tangent = volume == ObscuranceVolume::TangentSphere;
        let kernel = WorkKernelDescriptor {
            label: LABEL,
            entry: "obscurance_of_pixels",
            constants: &[
                ("POINTS", flag(points)),
                ("TANGENT", flag(tangent)),
                ("UPHILL", flag(params::turns_uphill(sampling, volume))),
                ("COUNT", params::split(sampling, volume).1.len() as f64),
            ],
            cache,
        };
        let moments = if takes_areas(sampling) {
            Some(DepthMomentsPass::new(device, cache)?)
        } else {
            None
        };
        Ok(Self {
            sampling,
            volume,
            moments,
            kernel: WorkKernel::new(device, &kernel, |list| source(variant(list)))?,
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Room for the moments of a view of `width` × `height` pixels. Only area samples read them.
    ///
    /// # Errors
    /// [`Error::Setting`] for a size of 0, [`Error::Limit`] for one beyond the device's buffers.
    pub fn create_moments(
        &self,
        device: &Device,
        width: u32,
        height: u32,
    ) -> Result<DepthMoments, Error> {
        DepthMoments::new(device, [width, height])
    }

    /// Whether its samples are areas.
    pub(crate) fn reads_moments(&self) -> bool {
        takes_areas(self.sampling)
    }

    /// Records the depth's moments: once per frame, before all recordings that read them.
    ///
    /// # Errors
    /// [`Error::Format`], [`Error::Size`], [`Error::Shape`] or [`Error::Usage`] for the depth, [`Error::Mismatch`] for moments
    /// of another size than the viewport's, or where the pass does not sample areas.
    pub fn record_moments(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        depth: TextureSlice<'_>,
        camera: &Camera,
        moments: &DepthMoments,
        timestamps: Option<Timestamps<'_>>,
    ) -> Result<(), Error> {
        check_timestamps(timestamps)?;
        check_depth("depth", &depth, camera.viewport())?;
        check_moments(moments, camera)?;
        let Some(pass) = &self.moments else {
            return Err(Error::Mismatch {
                name: "VolumetricObscurance",
                found: format!("{:?}", self.sampling),
                needed: "Areas or OneArea, which read moments".into(),
            });
        };
        pass.record(device, encoder, &depth.read(), camera, moments, timestamps);
        moments.recorded.set(*camera);
        Ok(())
    }

    /// Records the obscurance of the viewport's pixels, or of a list's.
    ///
    /// # Errors
    /// [`Error::Setting`] for the settings and the list's level, [`Error::Format`], [`Error::Size`], [`Error::Shape`] or
    /// [`Error::Usage`] for a texture, [`Error::Buffer`] for the list's, [`Error::Mismatch`] where normals or moments are
    /// missing, or are of another view; [`Error::Recording`] for moments that were not recorded.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &ObscuranceInput<'_>,
        settings: &ObscuranceSettings,
    ) -> Result<(), Error> {
        const DEPTH: &str = "ObscuranceInput::depth";
        const NORMALS: &str = "ObscuranceInput::normals";
        settings.validate()?;
        check_timestamps(input.timestamps)?;
        let viewport = input.camera.viewport();
        check_depth(DEPTH, &input.depth, viewport)?;
        let missing = |name, needed: String| Error::Mismatch {
            name,
            found: "none".into(),
            needed,
        };
        let normals = if self.volume == ObscuranceVolume::Sphere {
            None
        } else {
            let normals = input
                .normals
                .ok_or_else(|| missing(NORMALS, format!("some, for {:?}", self.volume)))?;
            normals.check(NORMALS, viewport)?;
            Some(normals)
        };
        let moments = if takes_areas(self.sampling) {
            const NAME: &str = "ObscuranceInput::moments";
            let moments = input
                .moments
                .ok_or_else(|| missing(NAME, format!("some, for {:?}", self.sampling)))?;
            check_moments(moments, input.camera)?;
            let camera = moments.recorded.get("DepthMoments")?;
            if camera != *input.camera {
                return Err(Error::Mismatch {
                    name: "DepthMoments",
                    found: format!("recorded for {camera:?}"),
                    needed: format!("{:?}", input.camera),
                });
            }
            Some(moments)
        } else {
            None
        };
        let level = check_work(
            device,
            "ObscuranceInput::target",
            input.work.as_ref(),
            viewport,
            &input.target,
            TARGET,
        )?;
        let reads = [(DEPTH, input.depth, 1)];
        let normal = normals.map(|normals| (NORMALS, normals.texture, 1));
        check_apart(
            "ObscuranceInput::target",
            &input.target,
            reads.into_iter().chain(normal),
        )?;
        let params = ObscuranceParams::new(settings, self.sampling, self.volume, input, level);
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        let depth = input.depth.read();
        let target = input.target.view(TextureUsages::STORAGE_BINDING);
        let normals = normals.map(|normals| normals.texture.read());
        let mut resources = vec![
            ("params", parameters.at(params)),
            ("depth_texture", view(&depth)),
            ("obscurance", view(&target)),
        ];
        resources.extend(normals.as_ref().map(|n| ("normal_texture", view(n))));
        resources.extend(moments.map(|m| ("moments", whole(&m.buffer))));
        self.kernel.record(
            device,
            encoder,
            resources,
            input.work.as_ref(),
            viewport,
            input.timestamps,
        );
        Ok(())
    }
}

fn takes_areas(sampling: ObscuranceSampling) -> bool {
    matches!(
        sampling,
        ObscuranceSampling::Areas(_) | ObscuranceSampling::OneArea
    )
}

fn check_moments(moments: &DepthMoments, camera: &Camera) -> Result<(), Error> {
    let viewport = camera.viewport();
    let [width, height] = moments.size;
    if [width, height] != [viewport.width, viewport.height] {
        return Err(Error::Mismatch {
            name: "DepthMoments",
            found: format!("{width}x{height} pixels"),
            needed: format!("{}x{}", viewport.width, viewport.height),
        });
    }
    Ok(())
}

/// What a module binds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ObscuranceVariant {
    pub normals: bool,
    pub areas: bool,
    pub list: bool,
}

impl ObscuranceVariant {
    fn new(sampling: ObscuranceSampling, volume: ObscuranceVolume, list: bool) -> Self {
        Self {
            normals: volume != ObscuranceVolume::Sphere,
            areas: takes_areas(sampling),
            list,
        }
    }
}

fn source(variant: ObscuranceVariant) -> Result<String, Error> {
    let flags = [
        (variant.normals, "NORMALS"),
        (variant.areas, "AREAS"),
        (variant.list, "LIST"),
    ];
    let flags: Vec<_> = flags.iter().filter(|f| f.0).map(|f| f.1).collect();
    shader::assemble("volumetric_obscurance", SOURCE, &flags, &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    for normals in [false, true] {
        for areas in [false, true] {
            for list in [false, true] {
                let name = name_of(
                    "volumetric_obscurance",
                    &[(normals, "normals"), (areas, "areas"), (list, "list")],
                );
                let variant = ObscuranceVariant {
                    normals,
                    areas,
                    list,
                };
                all.add(&name, source(variant)?);
            }
        }
    }
    Ok(())
}
