//! Image files: EXR for measuring, PNG for looking.

use std::path::Path;

/// Channels of one size as f32, rows from the top.
fn write_channels(
    path: &Path,
    width: u32,
    height: u32,
    channels: Vec<(&str, Vec<f32>)>,
) -> Result<(), String> {
    use exr::prelude::*;
    let channels = channels
        .into_iter()
        .map(|(name, values)| AnyChannel::new(name, FlatSamples::F32(values)))
        .collect();
    Image::from_channels(
        (width as usize, height as usize),
        AnyChannels::sort(channels),
    )
    .write()
    .to_file(path)
    .map_err(|e| format!("{}: {e}", path.display()))
}

/// One f32 channel `Y`, rows from the top.
pub fn write_exr(path: &Path, width: u32, height: u32, values: &[f32]) -> Result<(), String> {
    write_channels(path, width, height, vec![("Y", values.to_vec())])
}

/// Three f32 channels R, G, B, rows from the top.
pub fn write_exr_rgb(
    path: &Path,
    width: u32,
    height: u32,
    values: &[[f32; 3]],
) -> Result<(), String> {
    let channels = ["R", "G", "B"]
        .iter()
        .enumerate()
        .map(|(i, name)| (*name, values.iter().map(|v| v[i]).collect()))
        .collect();
    write_channels(path, width, height, channels)
}

/// Grey, 0…1 shown with the sRGB curve, so that mid greys look as they would in a renderer.
pub fn write_png(path: &Path, width: u32, height: u32, values: &[f32]) -> Result<(), String> {
    let bytes: Vec<u8> = values.iter().map(|&v| srgb(v)).collect();
    image::save_buffer(path, &bytes, width, height, image::ColorType::L8)
        .map_err(|e| format!("{}: {e}", path.display()))
}

/// Colours times `exposure`, 0…1 shown with the sRGB curve.
pub fn write_png_rgb(
    path: &Path,
    width: u32,
    height: u32,
    values: &[[f32; 3]],
    exposure: f32,
) -> Result<(), String> {
    let bytes: Vec<u8> = values
        .iter()
        .flatten()
        .map(|&v| srgb(v * exposure))
        .collect();
    image::save_buffer(path, &bytes, width, height, image::ColorType::Rgb8)
        .map_err(|e| format!("{}: {e}", path.display()))
}

/// Radiance to 0…1 as film takes it: 1 − exp(−exposure · radiance), so that highlights fade to white and are not cut.
pub fn tone_map(radiance: &[[f32; 3]], exposure: f32) -> Vec<[f32; 3]> {
    radiance
        .iter()
        .map(|color| color.map(|v| 1.0 - (-exposure * v).exp()))
        .collect()
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
