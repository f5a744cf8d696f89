//! Which pixels a multi-resolution mask computes, and what comes of it: `cargo run --release --example multires -- DIR`.
//!
//! For each effect writes the mask over the image, from red (full resolution) over green and blue to grey (1/8 alone), the
//! four sub-images, black where nothing was computed, the blended image and four times its difference from the image at
//! full resolution.

use std::path::{Path, PathBuf};

use deep_screen_space::scenes;
use support::{
    errors::rmse,
    files,
    gpu::{Ask, Gpu},
    multires::{Masked, read_blocks, read_image},
    near::{Effect, Passes, Stage},
};

const SIZE: [u32; 2] = [960, 540];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder: PathBuf = std::env::args().nth(1).unwrap_or("out".into()).into();
    std::fs::create_dir_all(&folder)?;
    let gpu = Gpu::open(Ask::from_env())?;
    let passes = Passes::new(&gpu.device)?;
    let scene = scenes::colonnade();
    let stage = Stage::new(&gpu, &passes, &scene, 0, SIZE)?;
    for effect in Effect::ALL {
        show(&passes, &stage, effect, &folder)?;
    }
    Ok(())
}

fn show(
    passes: &Passes,
    stage: &Stage<'_>,
    effect: Effect,
    folder: &Path,
) -> Result<(), Box<dyn std::error::Error>> {
    let gpu = stage.gpu;
    let [width, height] = SIZE;
    let full = gpu.storage(effect.format(), width, height);
    let mut masked = Masked::new(gpu, passes, effect, effect.mask(), SIZE)?;
    let mut encoder = gpu.encoder();
    passes.record(
        stage,
        &mut encoder,
        (effect, effect.samples()),
        None,
        full.texture(),
    )?;
    masked.record_masks(passes, stage, &mut encoder)?;
    masked.record_images(passes, stage, &mut encoder, effect.samples())?;
    masked.record_blend(stage, &mut encoder)?;
    gpu.finish(encoder);
    let save = |what: &str, [width, height]: [u32; 2], texels: &[[f32; 3]]| {
        let path = folder.join(format!("{}-{what}.png", effect.name()));
        files::write_png_rgb(&path, width, height, texels, 1.0)
    };
    let full = read_image(gpu, full.texture());
    let blended = read_image(gpu, masked.target.texture());
    save("full", SIZE, &full)?;
    save("blended", SIZE, &blended)?;
    let difference: Vec<[f32; 3]> = full
        .iter()
        .zip(&blended)
        .map(|(a, b)| [0, 1, 2].map(|k| 4.0 * (a[k] - b[k]).abs()))
        .collect();
    save("difference-x4", SIZE, &difference)?;

    let mut overlay: Vec<[f32; 3]> = blended.iter().map(|v| v.map(|c| 0.3 + 0.4 * c)).collect();
    for level in (0..4).rev() {
        let (Some(mask), Some(image)) = (masked.masks.mask(level), masked.images.level(level))
        else {
            continue;
        };
        let size = SIZE.map(|n| n.div_ceil(1 << level));
        let mask = read_blocks(gpu, mask, size);
        let part: Vec<[f32; 3]> = read_image(gpu, image)
            .into_iter()
            .zip(&mask)
            .map(|(v, &m)| if m > 0.0 { v } else { [0.0; 3] })
            .collect();
        save(&format!("level-{level}"), size, &part)?;
        let Some(channel) = [Some(0), Some(1), Some(2), None][level as usize] else {
            continue;
        };
        for (i, pixel) in (0..).zip(&mut overlay) {
            let [x, y] = [i % width, i / width].map(|p: u32| p >> level);
            if mask[(y * size[0] + x) as usize] > 0.0 {
                // Finer levels come last.
                let shade = pixel[0].max(pixel[1]).max(pixel[2]);
                *pixel = [0.15 * shade; 3];
                pixel[channel] = shade;
            }
        }
    }
    save("mask", SIZE, &overlay)?;
    let computed: u32 = masked.counts(gpu).iter().sum();
    println!(
        "{}: {:.1} % of the pixels computed, RMSE {:.4}",
        effect.name(),
        100.0 * f64::from(computed) / f64::from(width * height),
        rmse(full.as_flattened(), blended.as_flattened())
    );
    Ok(())
}
