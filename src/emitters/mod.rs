//! Pieces of a cloud that shine of themselves, as rays are aimed at them (`wgsl/emitters.wgsl`, `wgsl/common/emitters.wgsl`).

pub(crate) mod params;

use wgpu::{
    Buffer, BufferUsages, CommandEncoder, ComputePipeline, Device, Origin3d, TexelCopyBufferInfo,
    TexelCopyBufferLayout, TexelCopyTextureInfo, TextureAspect, TextureFormat, TextureUsages,
    TextureView, TextureViewDescriptor,
};

use self::params::EmittersParams;
use crate::{
    effect::Listing,
    error::Error,
    geometry::Material,
    gpu::compiler::Compiler,
    gpu::{
        Timestamps, WORKGROUP,
        binding::{self, Kept, Layout, view, whole},
        check_timestamps, compute_pass, dispatch,
        scan::{Scan, ScanBuffer},
        shader, storage,
        uniforms::Uniforms,
    },
    receivers::{plane_bytes, plane_for},
    recorded::{Last, Stamp},
    surfel::SurfelCloud,
};

const SOURCE: &str = include_str!("../../wgsl/emitters.wgsl");

const LABEL: &str = "deep-screen-space emitters";

const NAME: &str = "Emitters";

/// Texels of a row: `EMITTERS_A_ROW` of the shader.
const A_ROW: u32 = 4096;

/// The stages before the sums, in their order.
const STAGES: [&str; 2] = ["measure", "weigh"];

/// Finds what of a cloud shines of itself, so that rays can be aimed there: small lamps, which few of a pixel's own rays would
/// meet, are then found by each pixel that they reach. Pieces are drawn in proportion to their power, the luminance of their
/// emission times their area, however many they are.
///
/// A [`BouncedZBuffer`](crate::BouncedZBuffer) that was made for it aims
/// [`BouncedDescriptor::emitter_samples`](crate::BouncedDescriptor::emitter_samples) rays per pixel.
///
/// Holds pipelines only; one serves any number of clouds.
#[derive(Debug)]
pub struct EmittersBuilder {
    stages: Vec<(Layout, ComputePipeline)>,
    scan: Scan,
    uniforms: Uniforms,
}

/// Which pieces of a cloud shine of themselves, and how brightly: what an [`EmittersBuilder`] found, for
/// [`BouncedInput::emitters`](crate::BouncedInput::emitters).
#[derive(Debug)]
pub struct Emitters {
    /// Of the cloud: pieces.
    capacity: u32,
    /// A weight a piece, then the sums before it.
    weights: ScanBuffer,
    range: Buffer,
    /// These sums, as rays read them.
    table: TextureView,
    /// The cloud's recording.
    recorded: Last<Stamp>,
    kept: Kept,
}

/// What one recording of the [`EmittersBuilder`] works on.
#[derive(Clone, Copy, Debug)]
pub struct EmittersInput<'a> {
    /// The cloud, as it was last recorded.
    pub cloud: &'a SurfelCloud,
    /// A storage buffer of one or more [`Material`]s, that by which hits are lit. An index beyond its end takes the last one; a
    /// component that is negative or not finite counts as 0.
    pub materials: &'a Buffer,
    /// Where to write begin and end times, if anywhere.
    pub timestamps: Option<Timestamps<'a>>,
}

impl<'a> EmittersInput<'a> {
    /// Without timestamps.
    pub fn new(cloud: &'a SurfelCloud, materials: &'a Buffer) -> Self {
        Self {
            cloud,
            materials,
            timestamps: None,
        }
    }
}

impl Emitters {
    /// GPU memory that it owns, bytes.
    pub fn memory_bytes(&self) -> u64 {
        let size = table_size(self.capacity);
        self.weights.bytes() + self.range.size() + plane_bytes(TextureFormat::R32Uint, size, 1)
    }

    /// The table by which pieces are drawn (`R32Uint`, 4096 texels a row, usages `TEXTURE_BINDING | COPY_SRC`): in the texel of a
    /// piece the sum of the weights of those before it, and in the last texel of all. A weight is the piece's power as a share
    /// of the greatest.
    pub fn table(&self) -> &TextureView {
        &self.table
    }

    /// [`Error::Mismatch`] where it is of another size than a cloud, [`Error::Recording`] where it was not recorded from this
    /// cloud, since that was.
    pub(crate) fn check_source(&self, cloud: &SurfelCloud) -> Result<(), Error> {
        self.check_capacity(cloud)?;
        cloud.check_source(NAME, &self.recorded.get(NAME)?)
    }

    fn check_capacity(&self, cloud: &SurfelCloud) -> Result<(), Error> {
        if self.capacity == cloud.capacity.pieces {
            return Ok(());
        }
        Err(Error::Mismatch {
            name: NAME,
            found: format!("room for {} pieces", self.capacity),
            needed: format!("that of the cloud, {}", cloud.capacity.pieces),
        })
    }
}

/// One texel a piece, and one at least behind the last.
fn table_size(capacity: u32) -> [u32; 2] {
    [A_ROW, (capacity + 1).div_ceil(A_ROW)]
}

impl EmittersBuilder {
    /// Compiles the pipelines. Needs no features and nothing beyond `Limits::default()`.
    ///
    /// # Errors
    /// None today.
    pub fn new<'a>(compiler: impl Into<Compiler<'a>>) -> Result<Self, Error> {
        let Compiler { device, cache } = compiler.into();
        let module = shader::create(device, LABEL, source()?);
        let create = |entry| module.kernel(device, entry, &[], cache);
        Ok(Self {
            stages: STAGES.map(create).into(),
            scan: Scan::new(device, cache)?,
            uniforms: Uniforms::new(LABEL),
        })
    }

    /// Room for a cloud's.
    ///
    /// # Errors
    /// [`Error::Limit`] for more than the device can hold.
    pub fn create(&self, device: &Device, cloud: &SurfelCloud) -> Result<Emitters, Error> {
        let capacity = cloud.capacity.pieces;
        let size = table_size(capacity);
        let table = plane_for(
            device,
            LABEL,
            TextureFormat::R32Uint,
            size,
            1,
            TextureUsages::COPY_DST,
        )?;
        Ok(Emitters {
            capacity,
            // The last value is the sum of all.
            weights: self.scan.buffer(device, LABEL, size[0] * size[1] - 1)?,
            range: storage(device, LABEL, 8, BufferUsages::COPY_DST)?,
            table: table.create_view(&TextureViewDescriptor::default()),
            recorded: Last::default(),
            kept: Kept::default(),
        })
    }

    /// Records what of a cloud shines, which is to be done after each of its recordings.
    ///
    /// # Errors
    /// [`Error::Recording`] for a cloud that was not recorded; [`Error::Mismatch`] for another cloud's room; [`Error::Buffer`]
    /// and [`Error::Limit`] for materials.
    pub fn record(
        &self,
        device: &Device,
        encoder: &mut CommandEncoder,
        input: &EmittersInput<'_>,
        emitters: &Emitters,
    ) -> Result<(), Error> {
        let EmittersInput {
            cloud,
            materials,
            timestamps,
        } = *input;
        check_timestamps(timestamps)?;
        let stamp = cloud.last()?;
        emitters.check_capacity(cloud)?;
        binding::check_table::<Material>(device, "EmittersInput::materials", materials)?;
        let Emitters { weights, range, .. } = emitters;
        let [width, height] = table_size(emitters.capacity);
        let params = EmittersParams::new(emitters.capacity);
        let (parameters, params) = self.uniforms.upload_one(device, encoder, &params);
        let resources = [
            ("params", parameters.at(params)),
            ("counters", whole(&cloud.counters)),
            ("pieces", whole(&cloud.pieces)),
            ("materials", binding::table::<Material>(materials)),
            ("weights", whole(&weights.values)),
            ("range", whole(range)),
        ];
        encoder.clear_buffer(range, 0, None);
        let mut groups = emitters.kept.groups(device);
        let mut pass = compute_pass(encoder, LABEL, timestamps);
        for (layout, pipeline) in &self.stages {
            let bound: Vec<_> = resources
                .iter()
                .filter(|(name, _)| layout.names().any(|own| own == *name))
                .cloned()
                .collect();
            let group = groups.next(layout, &bound);
            let threads = width * height;
            dispatch(&mut pass, pipeline, &group, threads.div_ceil(WORKGROUP));
        }
        self.scan.record(&mut pass, weights);
        drop(pass);
        encoder.copy_buffer_to_texture(
            TexelCopyBufferInfo {
                buffer: &weights.values,
                layout: TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(4 * width),
                    rows_per_image: None,
                },
            },
            TexelCopyTextureInfo {
                texture: emitters.table.texture(),
                mip_level: 0,
                origin: Origin3d::ZERO,
                aspect: TextureAspect::All,
            },
            wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
        );
        emitters.recorded.set(stamp);
        Ok(())
    }
}

impl Emitters {
    /// The table as a binding.
    pub(crate) fn bound(&self) -> binding::Resource<'_> {
        view(&self.table)
    }
}

/// Assembles the module.
fn source() -> Result<String, Error> {
    shader::assemble("emitters", SOURCE, &[], &[])
}

/// Every module of the pass.
pub(crate) fn list(all: &mut Listing<'_>) -> Result<(), Error> {
    all.add("emitters", source()?);
    Ok(())
}
