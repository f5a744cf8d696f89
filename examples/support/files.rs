//! Image files: EXR for measuring, PNG for looking.

use std::path::Path;

/// One f32 channel `Y`, rows from the top.
pub fn write_exr(path: &Path, width: u32, height: u32, values: &[f32]) -> Result<(), String> {
    use exr::prelude::*;
    let channel = AnyChannel::new("Y", FlatSamples::F32(values.to_vec()));
    let image = Image::from_channels(
        (width as usize, height as usize),
        AnyChannels::sort(vec![channel].into_iter().collect()),
    );
    image
        .write()
        .to_file(path)
        .map_err(|e| format!("{}: {e}", path.display()))
}

/// Grey, 0…1 shown with the sRGB curve, so that mid greys look as they would in a renderer.
pub fn write_png(path: &Path, width: u32, height: u32, values: &[f32]) -> Result<(), String> {
    let bytes: Vec<u8> = values.iter().map(|&v| srgb(v)).collect();
    image::save_buffer(path, &bytes, width, height, image::ColorType::L8)
        .map_err(|e| format!("{}: {e}", path.display()))
}

fn srgb(linear: f32) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 {
        12.92 * v
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    };
    (encoded * 255.0).round() as u8
}
