//! Mirror of `wgsl/receivers.wgsl`.

use glam::{DVec2, DVec3};
use wgpu::TextureFormat;

use super::{packing::octahedral_to, shell_splatter::Receiver};
use crate::{Camera, NormalEncoding, NormalSpace, gbuffer::depth_step, receivers::DEPTH_RELATIVE};

/// What lies farther from the eye is sky.
const FARTHEST: f64 = 1e18;

/// A G-buffer's encoding.
#[derive(Clone, Copy, Debug)]
pub struct Decoder<'a> {
    /// The camera it was drawn with.
    pub camera: &'a Camera,
    /// The eye that positions shall be relative to.
    pub origin: DVec3,
    /// Format of the depth texture.
    pub depth_format: TextureFormat,
    /// How normals are stored.
    pub normal_encoding: NormalEncoding,
    /// The axes of the normals.
    pub normal_space: NormalSpace,
}

/// The unit vector along v, or `fallback` where it has no direction (`wgsl/common/math.wgsl`).
fn normalize_or(v: DVec3, fallback: DVec3) -> DVec3 {
    let scale = v.abs().max_element();
    if !v.is_finite() || scale < 1e-30 {
        return fallback;
    }
    (v / scale).normalize()
}

/// The albedo that a texel holds (`wgsl/common/albedo.wgsl`): what is not finite counts as black, the rest is 0…1.
pub fn decode_albedo(texel: DVec3) -> DVec3 {
    let decode = |v: f64| {
        if v.is_finite() {
            v.clamp(0.0, 1.0)
        } else {
            0.0
        }
    };
    DVec3::new(decode(texel.x), decode(texel.y), decode(texel.z))
}

impl Decoder<'_> {
    /// The point that a depth stands for, relative to the camera's eye.
    pub fn unproject(&self, pixel: [u32; 2], depth: f64) -> Option<DVec3> {
        let [x, y] = pixel.map(|i| f64::from(i) + 0.5);
        self.camera
            .unproject(x, y, depth)
            .filter(|p| p.abs().max_element() < FARTHEST)
    }

    /// A world-space unit normal; one that has no direction is taken to face the eye.
    pub fn decode_normal(&self, texel: DVec3, to_eye: DVec3) -> DVec3 {
        let encoding = self.normal_encoding;
        let mut v = texel;
        if matches!(
            encoding,
            NormalEncoding::Unsigned | NormalEncoding::OctahedralUnsigned
        ) {
            v = v * 2.0 - 1.0;
        }
        if matches!(
            encoding,
            NormalEncoding::Octahedral | NormalEncoding::OctahedralUnsigned
        ) {
            let e = v.truncate();
            if !e.is_finite() {
                return to_eye;
            }
            v = octahedral_to(e.clamp(DVec2::NEG_ONE, DVec2::ONE));
        }
        let n = normalize_or(v, DVec3::ZERO);
        if self.normal_space == NormalSpace::View {
            return normalize_or(self.camera.rotation().transpose() * n, to_eye);
        }
        normalize_or(n, to_eye)
    }

    /// What the passes read of a pixel of the viewport, given its texels; `None` for the sky. The shader packs the
    /// normal on top.
    pub fn prepare(&self, pixel: [u32; 2], depth: f64, normal: DVec3) -> Option<Receiver> {
        let p = self.unproject(pixel, depth)?;
        let n = self.decode_normal(normal, normalize_or(-p, DVec3::Z));
        let step = f64::from(depth_step(self.depth_format)) + f64::from(DEPTH_RELATIVE) * depth;
        let toward_eye = if self.camera.background_depth() == 0.0 {
            depth + step
        } else {
            depth - step
        };
        let nearer = self.unproject(pixel, toward_eye);
        let lift = nearer
            .filter(|_| step > 0.0)
            .map_or(0.0, |nearer| nearer.distance(p));
        Some(Receiver {
            position: p + (self.camera.eye() - self.origin) + n * lift,
            normal: n,
        })
    }
}
