//! Environments made in code, and of files.

use std::path::Path;

use deep_screen_space::{
    Environment, EnvironmentBuilder, EnvironmentInput, EnvironmentSettings, EnvironmentSource,
    Error,
    glam::{DVec3, Vec3},
    reference::environment::Picture,
    wgpu::{TextureFormat, TextureView},
};

use super::{files, gpu::Gpu};

pub const NAMES: [&str; 2] = ["sunny", "dim"];

/// Half the sun's width, four times that of the real one.
const SUN: f64 = 1.0;

/// A dim sky, brighter near the horizon on one side, over a dark ground: radiance from a unit vector.
pub fn dim(d: DVec3) -> DVec3 {
    if d.y <= 0.0 {
        return DVec3::new(0.1, 0.08, 0.06);
    }
    DVec3::new(0.3, 0.5, 0.9) * (0.4 + 0.6 * (1.0 - d.y) * (0.5 + 0.5 * d.x))
}

/// The same with a small sun, which gives a surface that faces it about four times what the sky does.
pub fn sunny(d: DVec3) -> DVec3 {
    let sun = DVec3::new(0.5, 0.7, 0.4).normalize();
    let is_sun = d.dot(sun) > SUN.to_radians().cos();
    dim(d) + DVec3::new(1.0, 0.9, 0.7) * if is_sun { 6500.0 } else { 0.0 }
}

/// One of [`NAMES`], finely.
pub fn by_name(name: &str) -> Option<Picture> {
    let size = [512, 256];
    match name {
        "sunny" => Some(Picture::of(size, sunny)),
        "dim" => Some(Picture::of(size, dim)),
        _ => None,
    }
}

/// One of [`NAMES`], or a file's: a picture of latitude and longitude, rows from the top, of at most so many columns and rows.
pub fn open(name: &str, most: u32) -> Result<Picture, String> {
    if let Some(picture) = by_name(name) {
        return Ok(picture);
    }
    let path = Path::new(name);
    // A file's format is told by its ending.
    if path.extension().is_none() {
        let names = NAMES.join(" nor ");
        return Err(format!(
            "{name} is neither {names} nor a file with the ending of an EXR, HDR, PNG or JPEG"
        ));
    }
    let (size, texels) = files::read_radiance(path, most)?;
    let texels = texels.iter().map(|t| Vec3::from_array(*t).as_dvec3());
    Ok(Picture {
        size,
        texels: texels.collect(),
    })
}

/// A picture as a texture.
pub fn texture(gpu: &Gpu, picture: &Picture) -> TextureView {
    let texel = |t: &DVec3| t.as_vec3().extend(1.0).to_array();
    let texels: Vec<[f32; 4]> = picture.texels.iter().map(texel).collect();
    let [width, height] = picture.size.map(|n| n as u32);
    gpu.texture(TextureFormat::Rgba32Float, width, height, &texels)
}

/// An environment of a picture.
pub fn build(
    gpu: &Gpu,
    builder: &EnvironmentBuilder,
    picture: &Picture,
    settings: &EnvironmentSettings,
) -> Result<Environment, Error> {
    let environment = builder.create(&gpu.device, settings)?;
    let texture = texture(gpu, picture);
    let source = EnvironmentSource::Equirectangular(texture.texture().into());
    let mut encoder = gpu.encoder();
    let input = EnvironmentInput::new(source);
    builder.record(&gpu.device, &mut encoder, &input, &environment)?;
    gpu.finish(encoder);
    Ok(environment)
}
