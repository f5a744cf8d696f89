//! A G-buffer by casting a ray through each pixel's centre: any camera, f64, no rasteriser.

use glam::DVec3;

use super::trace::{Receiver, Tracer};
use crate::camera::Camera;

/// What a pixel sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Position and normals, in the world.
    pub receiver: Receiver,
    /// The depth that the camera's projection gives it.
    pub depth: f64,
    /// Its triangle, in the list that the tracer was made from.
    pub triangle: usize,
}

/// Casts the rays of a camera's viewport, rows from the top; `None` where nothing is between the near plane and infinity.
///
/// The geometric normal faces the viewer and the shading normal, interpolated from `normals`, lies on its side.
pub fn cast(
    camera: &Camera,
    tracer: &Tracer,
    positions: &[[f32; 3]],
    normals: &[[f32; 3]],
    indices: &[u32],
) -> Vec<Option<Pixel>> {
    let viewport = camera.viewport();
    let near_depth = 1.0 - f64::from(camera.background_depth());
    (0..viewport.width * viewport.height)
        .map(|i| {
            let x = f64::from(i % viewport.width) + 0.5;
            let y = f64::from(i / viewport.width) + 0.5;
            let near = camera.unproject(x, y, near_depth)?;
            let direction = camera.line_of_sight(x, y).1.normalize();
            let origin = camera.eye() + near;
            let hit = tracer.first_hit(origin, direction, 0.0, f64::INFINITY)?;
            let corner = |k: usize| indices[3 * hit.triangle + k] as usize;
            let at = |list: &[[f32; 3]], k| DVec3::from(list[corner(k)].map(f64::from));
            let [p0, p1, p2] = [0, 1, 2].map(|k| at(positions, k));
            let facing = (p1 - p0).cross(p2 - p0).normalize();
            let geometric_normal = if facing.dot(direction) > 0.0 {
                -facing
            } else {
                facing
            };
            let [u, v] = hit.barycentric;
            // By the corners: the eye may be so far that what its distance is rounded to lies off the surface.
            let position = p0 + (p1 - p0) * u + (p2 - p0) * v;
            let smooth = at(normals, 0) * (1.0 - u - v) + at(normals, 1) * u + at(normals, 2) * v;
            let shading = smooth.try_normalize().unwrap_or(geometric_normal);
            Some(Pixel {
                receiver: Receiver {
                    position,
                    geometric_normal,
                    shading_normal: if shading.dot(geometric_normal) < 0.0 {
                        -shading
                    } else {
                        shading
                    },
                },
                depth: camera.project(position - camera.eye())?.z,
                triangle: hit.triangle,
            })
        })
        .collect()
}

/// The receivers alone.
pub fn receivers(
    camera: &Camera,
    tracer: &Tracer,
    positions: &[[f32; 3]],
    normals: &[[f32; 3]],
    indices: &[u32],
) -> Vec<Option<Receiver>> {
    cast(camera, tracer, positions, normals, indices)
        .into_iter()
        .map(|pixel| pixel.map(|p| p.receiver))
        .collect()
}
