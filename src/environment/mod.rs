//! Light from infinitely far away, prepared for rays (`wgsl/environment.wgsl`).

pub(crate) mod params;
pub(crate) mod settings;

use glam::DQuat;
use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device, TextureFormat, TextureUsages,
    TextureView,
};

use self::{
    params::{EnvironmentParams, LobesParams, MAX_LOBES},
    settings::EnvironmentSettings,
};
use crate::{
    effect::Listing,
    error::{Error, check_setting},
    gpu::compiler::Compiler,
    gpu::{
        Timestamps,
        binding::{Layout, Named, view, whole},
        check_timestamps, compute_pass, shader, storage,
        uniforms::{Parameters, Place, Uniforms},
    },
    receivers::{mipped_plane, plane, plane_bytes},
    recorded::Recordings,
    spherical_gaussian::SphericalGaussian,
    texture_slice::{TextureSlice, check_layers},
};

const SOURCE: &str = include_str!("../../wgsl/environment.wgsl");

const LABEL: &str = "deep-screen-space environment";

/// The stages, in their order.
const STAGES: [&str; 4] = ["cells", "rows", "columns", "irradiance"];

/// Texels of the source that a cell may be as wide or as high as: a cell is a loop over its texels.
const MOST_TEXELS: u32 = 128;

/// Prepares an [`Environment`] for rays, whenever what it shows changes: resamples it to a grid of cells, makes the tables by
/// which rays are drawn in proportion to what comes from there (Pharr, Jakob and Humphreys, *Physically Based Rendering*, 4th
/// edition 2023, section 12.5.2), and the irradiance that it gives without anything in its way.
///
/// Holds pipelines only; one serves any number of environments.
///
/// ```no_run
/// use deep_screen_space::*;
///
/// /// What white surfaces send on of a sky, an equirectangular picture, into an `Rgba16Float` texture.
/// fn skylight(
///     device: &wgpu::Device,
///     encoder: &mut wgpu::CommandEncoder,
///     sky: &wgpu::Texture,
///     scene: &RayTracedScene,
///     (gbuffer, camera): (GBuffer<'_>, &Camera),
///     target: &wgpu::Texture,
/// ) -> Result<(), Error> {
///     // Once, and the recording whenever the sky changes.
///     let builder = EnvironmentBuilder::new(device)?;
///     let environment = builder.create(device, &EnvironmentSettings::default())?;
///     let picture = EnvironmentInput::new(EnvironmentSource::Equirectangular(sky.into()));
///     builder.record(device, encoder, &picture, &environment)?;
///     let effect = RayTracedEffect::DirectionalOcclusion { radius: f32::INFINITY };
///     let format = wgpu::TextureFormat::Rgba16Float;
///     let descriptor = RayTracedViewDescriptor::new(effect, Quality::Balanced, format);
///     let mut view = RayTracedView::new(device, &descriptor)?;
///
///     // Every frame, after the scene's recording.
///     let input = RayTracedInput {
///         environment: Some(EnvironmentLight::new(&environment)),
///         ..RayTracedInput::new(gbuffer, camera, target)
///     };
///     view.record(device, encoder, scene, &input)
/// }
/// ```
#[derive(Debug)]
pub struct EnvironmentBuilder {
    picture: Vec<(Layout, ComputePipeline)>,
    /// Of a sum the first stage alone is another.
    summed: (Layout, ComputePipeline),
    uniforms: Uniforms,
}

/// Light from infinitely far away: what an [`EnvironmentBuilder`] made of its source, for
/// [`BouncedInput::environment`](crate::BouncedInput::environment).
#[derive(Debug)]
pub struct Environment {
    size: [u32; 2],
    radiance: TextureView,
    /// Of that texture each mip level by itself, and all of them, where there are several.
    levels: Option<(Vec<TextureView>, TextureView)>,
    distribution: TextureView,
    row_powers: Buffer,
    irradiance: Buffer,
    pub(crate) recorded: Recordings,
}

impl Environment {
    /// Columns and rows of its cells.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The radiance of its cells, W/(m² sr), as an [`EnvironmentSource::Equirectangular`] picture (`Rgba32Float`, usages
    /// `TEXTURE_BINDING | COPY_SRC`).
    pub fn radiance(&self) -> &TextureView {
        &self.radiance
    }

    /// The distribution that rays are drawn by (`R32Float`, usages `TEXTURE_BINDING | COPY_SRC`): in each row, up to each cell,
    /// the share of what the whole row has; and in one row more, up to each row, the share of all, by radiance times solid angle,
    /// the mean of the channels.
    pub fn distribution(&self) -> &TextureView {
        &self.distribution
    }

    /// The irradiance that a surface has of it without anything in its way, W/m²: nine `vec4<f32>` of red, green and blue, which
    /// times 1, y, z, x, xy, yz, 3z² − 1, xz, x² − y² of its unit normal, in the environment's own axes, and added up are the
    /// irradiance (Ramamoorthi and Hanrahan, *An Efficient Representation for Irradiance Environment Maps*, 2001; usages
    /// `STORAGE | COPY_SRC`). Spherical harmonics up to order 2: within a hundredth for what changes slowly over the sky; a sun
    /// is off by up to a tenth of what it gives a surface that faces it, which below the horizon may be less than nothing.
    pub fn irradiance(&self) -> &Buffer {
        &self.irradiance
    }

    /// In how many grids it is kept, 1 without [`EnvironmentSettings::levels`]: mip levels of the texture of its radiance.
    pub fn levels(&self) -> u32 {
        self.radiance.texture().mip_level_count()
    }

    /// What effects by splatting read of it, by the names of `wgsl/common/environment_levels.wgsl`.
    pub(crate) fn splatted(&self) -> [Named<'_>; 2] {
        let all = self.levels.as_ref().map_or(&self.radiance, |(_, all)| all);
        [
            ("environment_levels", view(all)),
            ("environment_irradiance", whole(&self.irradiance)),
        ]
    }

    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        (0..self.levels())
            .map(|level| plane_bytes(TextureFormat::Rgba32Float, grid_of(self.size, level), 1))
            .sum::<u64>()
            + plane_bytes(TextureFormat::R32Float, table_size(self.size), 1)
            + self.row_powers.size()
            + self.irradiance.size()
    }
}

/// The cells of a level.
fn grid_of(size: [u32; 2], level: u32) -> [u32; 2] {
    size.map(|n| (n >> level).max(1))
}

/// How many levels there are down to two rows.
fn levels_of([_, rows]: [u32; 2]) -> u32 {
    rows.ilog2().max(1)
}

/// The rows of the cells, and that of the rows.
fn table_size([columns, rows]: [u32; 2]) -> [u32; 2] {
    [columns, rows + 1]
}

/// What an [`Environment`] is made of. What is not a number or negative counts as 0, and what is above 1e18 as that.
#[derive(Clone, Copy, Debug)]
pub enum EnvironmentSource<'a> {
    /// A picture of latitude and longitude, of any float format and size up to 128 texels per cell each way, usage
    /// `TEXTURE_BINDING`: radiance, W/(m² sr). Its uppermost row is about +Y, its lowest about −Y; +X is in the middle of its
    /// width and +Z a quarter of the width to the right of that, so that it is seen from within as it is printed.
    Equirectangular(TextureSlice<'a>),
    /// Radiance as real spherical harmonics of orders 0 to 2, in the order of [`Environment::irradiance`]'s polynomials and
    /// normalised (0.282095 is the first, of Ramamoorthi and Hanrahan 2001, equation 3), each a red, green and blue, W/(m² sr).
    SphericalHarmonics(&'a [[f32; 3]; 9]),
    /// Radiance as a sum of up to 16 spherical Gaussians, each with what its amplitude is multiplied by for red, green and blue,
    /// W/(m² sr). Those that are narrower than a cell are not seen as they are.
    SphericalGaussians(&'a [(SphericalGaussian, [f32; 3])]),
}

/// What one recording of the [`EnvironmentBuilder`] works on.
#[derive(Clone, Copy, Debug)]
pub struct EnvironmentInput<'a> {
    /// What it shows.
    pub source: EnvironmentSource<'a>,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> EnvironmentInput<'a> {
    /// Without timestamps.
    pub fn new(source: EnvironmentSource<'a>) -> Self {
        Self {
            source,
            timestamps: None,
        }
    }
}

/// An environment, and how it is turned in the world.
#[derive(Clone, Copy, Debug)]
pub struct EnvironmentLight<'a> {
    /// The environment, which was recorded.
    pub environment: &'a Environment,
    /// From its own axes to the world's; a rotation, of length 1. May change each frame: nothing is built anew.
    pub rotation: DQuat,
}

impl<'a> EnvironmentLight<'a> {
    /// As it is.
    pub fn new(environment: &'a Environment) -> Self {
        Self {
            environment,
            rotation: DQuat::IDENTITY,
        }
    }

    /// Checks the rotation, and that the environment was recorded.
    ///
    /// # Errors
    /// [`Error::Setting`], [`Error::Recording`].
    pub fn validate(&self) -> Result<(), Error> {
        let length = self.rotation.length();
        check_setting(
            (length - 1.0).abs() <= 1e-3,
            "EnvironmentLight::rotation",
            length,
            "a rotation, of length 1",
        )?;
        self.environment.recorded.last("Environment").map(|_| ())
    }
}

impl EnvironmentBuilder {
    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// None today.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        let picture = shader::create(device, LABEL, source(false)?);
        let summed = shader::create(device, LABEL, source(true)?);
        Ok(Self {
            picture: STAGES
                .map(|entry| picture.kernel(device, entry, &[], cache))
                .into(),
            summed: summed.kernel(device, STAGES[0], &[], cache),
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Room for an environment.
    ///
    /// # Errors
    /// What [`EnvironmentSettings::validate`] finds; [`Error::Limit`] for more than the device can hold.
    pub fn create(
        &self,
        device: &Device,
        settings: &EnvironmentSettings,
    ) -> Result<Environment, Error> {
        settings.validate()?;
        let size = settings.size;
        let buffer = |label, bytes| storage(device, label, bytes, BufferUsages::COPY_SRC);
        let count = if settings.levels { levels_of(size) } else { 1 };
        let radiance = mipped_plane(
            device,
            "deep-screen-space environment radiance",
            TextureFormat::Rgba32Float,
            size,
            count,
        )?;
        let distribution = plane(
            device,
            "deep-screen-space environment distribution",
            TextureFormat::R32Float,
            table_size(size),
            1,
        )?;
        let level = |level| {
            radiance.create_view(&wgpu::TextureViewDescriptor {
                base_mip_level: level,
                mip_level_count: Some(1),
                ..Default::default()
            })
        };
        let whole =
            |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        Ok(Environment {
            size,
            radiance: level(0),
            levels: (count > 1).then(|| ((0..count).map(level).collect(), whole(&radiance))),
            distribution: whole(&distribution),
            row_powers: buffer("deep-screen-space environment rows", 4 * u64::from(size[1]))?,
            irradiance: buffer("deep-screen-space environment irradiance", 9 * 16)?,
            recorded: Recordings::default(),
        })
    }

    /// Records what an environment shows from now on.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::Format`] and [`Error::Usage`] for a picture; [`Error::Mismatch`] for one of more than 128
    /// texels per cell each way; [`Error::Setting`] for more than 16 lobes.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &EnvironmentInput<'_>,
        environment: &Environment,
    ) -> Result<(), Error> {
        check_timestamps(input.timestamps)?;
        let size = environment.size;
        let mut parameters = Parameters::new(device);
        let mut params = EnvironmentParams {
            size,
            source_size: size,
        };
        let shown = match input.source {
            EnvironmentSource::Equirectangular(slice) => {
                check_picture(device, &slice, size)?;
                params.source_size = slice.size();
                Shown::Picture(slice.read())
            }
            EnvironmentSource::SphericalHarmonics(harmonics) => {
                Shown::Lobes(parameters.add(&LobesParams::new(harmonics, &[])))
            }
            EnvironmentSource::SphericalGaussians(lobes) => {
                check_setting(
                    lobes.len() <= MAX_LOBES,
                    "EnvironmentSource::SphericalGaussians",
                    lobes.len() as f64,
                    "up to 16 lobes",
                )?;
                Shown::Lobes(parameters.add(&LobesParams::new(&[[0.0; 3]; 9], lobes)))
            }
        };
        environment.recorded.advance();
        let params = parameters.add(&params);
        // Each level is made of the one before as the first is of a picture.
        let steps: Vec<_> = (1..environment.levels())
            .map(|level| {
                let [source_size, size] = [level - 1, level].map(|level| grid_of(size, level));
                (
                    level,
                    size,
                    parameters.add(&EnvironmentParams { size, source_size }),
                )
            })
            .collect();
        let parameters = self.uniforms.upload(device, encoder, &parameters);
        let (first, shown) = match &shown {
            Shown::Picture(picture) => (&self.picture[0], view(picture)),
            Shown::Lobes(lobes) => (&self.summed, parameters.at(*lobes)),
        };
        let resources = [
            ("params", parameters.at(params)),
            ("source", shown),
            ("radiance_out", view(&environment.radiance)),
            ("radiance", view(&environment.radiance)),
            ("distribution", view(&environment.distribution)),
            ("row_powers", whole(&environment.row_powers)),
            ("irradiance_out", whole(&environment.irradiance)),
        ];
        let [columns, rows] = size;
        let workgroups = [
            [columns.div_ceil(8), rows.div_ceil(8)],
            [rows.div_ceil(64), 1],
            [1, 1],
            [1, 1],
        ];
        let mut pass = compute_pass(encoder, LABEL, input.timestamps);
        for (i, [x, y]) in workgroups.into_iter().enumerate() {
            let (layout, pipeline) = if i == 0 { first } else { &self.picture[i] };
            let names: Vec<_> = layout.names().collect();
            let bound: Vec<_> = resources
                .iter()
                .filter(|(name, _)| names.contains(name))
                .cloned()
                .collect();
            let group = layout.group(device, &bound);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group.raw, &group.offsets);
            pass.dispatch_workgroups(x, y, 1);
        }
        let Some((levels, _)) = &environment.levels else {
            return Ok(());
        };
        let (layout, pipeline) = &self.picture[0];
        pass.set_pipeline(pipeline);
        for (level, [columns, rows], params) in steps {
            let level = level as usize;
            let resources = [
                ("params", parameters.at(params)),
                ("source", view(&levels[level - 1])),
                ("radiance_out", view(&levels[level])),
            ];
            let group = layout.group(device, &resources);
            pass.set_bind_group(0, &group.raw, &group.offsets);
            pass.dispatch_workgroups(columns.div_ceil(8), rows.div_ceil(8), 1);
        }
        Ok(())
    }
}

/// A source on the GPU.
enum Shown {
    Picture(TextureView),
    Lobes(Place),
}

fn check_picture(device: &Device, slice: &TextureSlice<'_>, cells: [u32; 2]) -> Result<(), Error> {
    const SOURCE: &str = "EnvironmentSource::Equirectangular";
    check_layers(SOURCE, slice, 1, TextureUsages::TEXTURE_BINDING)?;
    let format = slice.view_format();
    let sample = format.sample_type(None, Some(device.features()));
    if format.has_depth_aspect() || !matches!(sample, Some(wgpu::TextureSampleType::Float { .. })) {
        return Err(Error::Format {
            name: SOURCE,
            format,
            accepted: "a colour format of floats",
        });
    }
    let size = slice.size();
    let most = cells.map(|cells| cells * MOST_TEXELS);
    if size[0] > most[0] || size[1] > most[1] {
        return Err(Error::Mismatch {
            name: SOURCE,
            found: format!("{size:?} texels"),
            needed: format!("at most {most:?} texels, 128 per cell each way"),
        });
    }
    Ok(())
}

/// The module, of a picture or of a sum.
fn source(summed: bool) -> Result<String, Error> {
    let flags: &[&str] = if summed { &["SUMMED"] } else { &[] };
    shader::assemble("environment", SOURCE, flags, &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add("environment", source(false)?);
    all.add("environment summed", source(true)?);
    Ok(())
}
