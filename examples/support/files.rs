//! Image files: EXR for measuring, PNG for looking.

use std::{fmt::Display, path::Path};

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

fn is_exr(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("exr"))
}

/// Columns and rows that a file says it has, before anything is made of that size.
fn size_of(path: &Path) -> Result<[usize; 2], String> {
    let problem = |e: &dyn Display| format!("{}: {e}", path.display());
    if is_exr(path) {
        let head = exr::meta::MetaData::read_from_file(path, false).map_err(|e| problem(&e))?;
        // The most of any layer: which one is read the reader decides.
        let sizes = head.headers.iter().map(|layer| layer.layer_size);
        let largest = sizes.reduce(exr::math::Vec2::max).unwrap_or_default();
        return Ok([largest.width(), largest.height()]);
    }
    let reader = image::ImageReader::open(path).map_err(|e| problem(&e))?;
    let (width, height) = reader.into_dimensions().map_err(|e| problem(&e))?;
    Ok([width, height].map(|n| n as usize))
}

/// Columns and rows, 1 to `most` of each, and texels from the top: of an EXR or HDR file as they are, of others, which hold
/// sRGB, in linear light.
pub fn read_radiance(path: &Path, most: u32) -> Result<([usize; 2], Vec<[f32; 3]>), String> {
    let problem = |e: &dyn Display| format!("{}: {e}", path.display());
    let [width, height] = size_of(path)?;
    if [width, height]
        .iter()
        .any(|n| !(1..=most as usize).contains(n))
    {
        return Err(problem(&format_args!(
            "{width}x{height} texels, where 1x1 to {most}x{most} can be read"
        )));
    }
    if is_exr(path) {
        use exr::prelude::*;
        let image = read_first_rgba_layer_from_file(
            path,
            |size, _| (size, vec![[0.0; 3]; size.area()]),
            |(size, texels): &mut (Vec2<usize>, Vec<[f32; 3]>),
             at,
             (r, g, b, _): (f32, f32, f32, f32)| {
                texels[at.flat_index_for_size(*size)] = [r, g, b];
            },
        )
        .map_err(|e| problem(&e))?;
        let (size, texels) = image.layer_data.channel_data.pixels;
        return Ok(([size.width(), size.height()], texels));
    }
    let image = image::open(path).map_err(|e| problem(&e))?;
    let is_linear = matches!(
        image.color(),
        image::ColorType::Rgb32F | image::ColorType::Rgba32F
    );
    let image = image.into_rgb32f();
    let size = [image.width(), image.height()].map(|n| n as usize);
    let to_light = |v: f32| if is_linear { v } else { from_srgb(v) };
    Ok((size, image.pixels().map(|p| p.0.map(to_light)).collect()))
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

/// The light that an sRGB value of 0 to 1 stands for.
pub fn from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.04045 {
        encoded / 12.92
    } else {
        ((encoded + 0.055) / 1.055).powf(2.4)
    }
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
