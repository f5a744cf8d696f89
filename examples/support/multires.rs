//! Effects over the sub-images of a multi-resolution mask: what the bench times and the example shows.

use deep_screen_space::{
    Error, MultiResMaskInput, MultiResMaskSettings, MultiResReconstructor,
    MultiResReconstructorInput, MultiResReconstructorSettings, MultiResView, SubImages,
    wgpu::{self, TextureFormat, TextureView},
};

use super::{
    gpu::Gpu,
    near::{Effect, Passes, Stage},
};

/// An effect by sub-images: the masks, the sub-images and their blend.
pub struct Masked {
    effect: Effect,
    settings: MultiResMaskSettings,
    pub masks: MultiResView,
    pub images: SubImages,
    blend: MultiResReconstructor,
    /// Hard shadows, for masks that know of them.
    hard: TextureView,
    /// The blended image: `R32Float` or `Rgba16Float`.
    pub target: TextureView,
}

impl Masked {
    pub fn new(
        gpu: &Gpu,
        passes: &Passes,
        effect: Effect,
        settings: MultiResMaskSettings,
        [width, height]: [u32; 2],
    ) -> Result<Self, Error> {
        let device = &gpu.device;
        let blend = MultiResReconstructor::new(device, effect.channels(), effect.format())?;
        Ok(Self {
            effect,
            settings,
            masks: passes.mask.create_view(device, width, height, false)?,
            images: blend.create_images(device, width, height, &settings)?,
            blend,
            hard: gpu.storage(TextureFormat::R32Float, width, height),
            target: gpu.target(effect.format(), width, height),
        })
    }

    /// The masks, with what they need.
    pub fn record_masks(
        &mut self,
        passes: &Passes,
        stage: &Stage<'_>,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Result<(), Error> {
        let is_shadow = self.effect == Effect::Shadow;
        if is_shadow {
            passes.record_hard_shadows(stage, encoder, self.hard.texture())?;
        }
        passes.mask.record(
            &stage.gpu.device,
            encoder,
            &MultiResMaskInput {
                gbuffer: stage.drawn.gbuffer(),
                camera: &stage.camera,
                shading: is_shadow.then_some(self.hard.texture().into()),
                edges: None,
                importance: None,
                timestamps: None,
            },
            &self.settings,
            &mut self.masks,
        )
    }

    /// The sub-images, of the masks that were recorded.
    pub fn record_images(
        &self,
        passes: &Passes,
        stage: &Stage<'_>,
        encoder: &mut wgpu::CommandEncoder,
        samples: u32,
    ) -> Result<(), Error> {
        for work in self.masks.works() {
            let Some(image) = self.images.level(work.level) else {
                continue;
            };
            passes.record(stage, encoder, (self.effect, samples), Some(work), image)?;
        }
        Ok(())
    }

    /// The image of the sub-images.
    pub fn record_blend(
        &self,
        stage: &Stage<'_>,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Result<(), Error> {
        self.blend.record(
            &stage.gpu.device,
            encoder,
            &MultiResReconstructorInput {
                gbuffer: stage.drawn.gbuffer(),
                camera: &stage.camera,
                masks: &self.masks,
                images: &self.images,
                target: self.target.texture().into(),
                timestamps: None,
            },
            &MultiResReconstructorSettings::default(),
        )
    }

    /// How many pixels each level computes; 0 where there is no such level.
    pub fn counts(&self, gpu: &Gpu) -> [u32; 4] {
        [0, 1, 2, 3].map(|level| {
            self.masks.work(level).map_or(0, |work| {
                let words: Vec<u32> = gpu.read_buffer(work.pixels);
                words[0]
            })
        })
    }
}

/// The pixels of a texture of blocks, such as a mask, rows from the top; `size` is theirs.
pub fn read_blocks(gpu: &Gpu, view: &TextureView, [width, height]: [u32; 2]) -> Vec<f32> {
    let blocks: Vec<[u8; 4]> = gpu.read_texture(view.texture(), 0);
    let columns = width.div_ceil(2);
    (0..width * height)
        .map(|i| {
            let [x, y] = [i % width, i / width];
            let block = blocks[((y / 2) * columns + x / 2) as usize];
            f32::from(block[(y % 2 * 2 + x % 2) as usize]) / 255.0
        })
        .collect()
}

/// The texels of an image of either format, rows from the top: three channels each.
pub fn read_image(gpu: &Gpu, texture: &wgpu::Texture) -> Vec<[f32; 3]> {
    if texture.format() == TextureFormat::R32Float {
        let texels: Vec<f32> = gpu.read_texture(texture, 0);
        return texels.into_iter().map(|v| [v; 3]).collect();
    }
    if texture.format() == TextureFormat::Rgba32Float {
        let texels: Vec<[f32; 4]> = gpu.read_texture(texture, 0);
        return texels.into_iter().map(|[r, g, b, _]| [r, g, b]).collect();
    }
    let texels: Vec<[u16; 4]> = gpu.read_texture(texture, 0);
    texels
        .into_iter()
        .map(|[r, g, b, _]| [r, g, b].map(half_to_f32))
        .collect()
}

/// The number that a half holds.
pub fn half_to_f32(bits: u16) -> f32 {
    let sign = if bits >> 15 == 0 { 1.0 } else { -1.0 };
    let exponent = i32::from((bits >> 10) & 31);
    let mantissa = f32::from(bits & 1023) / 1024.0;
    sign * match exponent {
        0 => mantissa * 2_f32.powi(-14),
        31 if mantissa == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1.0 + mantissa) * 2_f32.powi(exponent - 15),
    }
}
