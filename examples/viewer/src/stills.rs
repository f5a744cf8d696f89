//! Pictures as files: EXR for measuring, PNG for looking.

use std::path::{Path, PathBuf};

use support::{files, gpu::Gpu, multires::read_image};

use crate::{
    display::exposure_of,
    look::{Effect, Look},
    passes::Passes,
};

/// Writes a side's picture beside what was written before, and says where the PNG is.
///
/// # Errors
/// A line that says what could not be written.
pub fn write(
    gpu: &Gpu,
    folder: &Path,
    (look, passes): (&Look, &Passes),
    exposure: f32,
) -> Result<PathBuf, String> {
    std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let name = format!("{}-{}", look.effect.short(), look.method.short());
    let free = |n: &u32| !folder.join(format!("{name}-{n}.png")).exists();
    let number = (1..u32::MAX).find(free).unwrap_or_default();
    let path = |kind: &str| folder.join(format!("{name}-{number}.{kind}"));
    let texture = passes.target().texture();
    let (width, height) = (texture.width(), texture.height());
    let pixels = read_image(gpu, texture);
    let png = path("png");
    if look.effect.is_grey() {
        let grey: Vec<f32> = pixels.iter().map(|p| p[0]).collect();
        files::write_exr(&path("exr"), width, height, &grey)?;
        let shown: Vec<f32> = grey.iter().map(|v| exposure * v).collect();
        files::write_png(&png, width, height, &shown)?;
        return Ok(png);
    }
    files::write_exr_rgb(&path("exr"), width, height, &pixels)?;
    let shown: Vec<[f32; 3]> = if look.effect == Effect::BentNormals {
        let direction = |n: f32| (0.5 * n + 0.5).clamp(0.0, 1.0).powf(2.2);
        pixels.iter().map(|p| p.map(direction)).collect()
    } else {
        let scale = exposure * exposure_of(look);
        pixels.iter().map(|p| p.map(|v| scale * v)).collect()
    };
    files::write_png_rgb(&png, width, height, &shown, 1.0)?;
    Ok(png)
}
