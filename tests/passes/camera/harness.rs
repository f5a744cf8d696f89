//! Cameras of all kinds, and whether a receiver is where one of them has it.

use std::f64::consts::FRAC_PI_3;

use deep_screen_space::{
    Camera, Viewport,
    glam::{
        DMat3, DMat4, DVec2, DVec3,
        dcamera::{lh::proj::directx as left, rh::proj::directx as right},
    },
    reference::{receivers::Decoder, shell_splatter::Receiver},
    wgpu::TextureFormat as Format,
};

/// 0 ≤ x < 1, the same for the same inputs.
pub fn random(a: u32, b: u32) -> f64 {
    let mut x = a.wrapping_mul(0x9e37_79b9) ^ b.wrapping_mul(0x85eb_ca6b) ^ 0x5bd1_e995;
    for _ in 0..3 {
        x ^= x >> 15;
        x = x.wrapping_mul(0x2c1b_3c6d);
        x ^= x >> 13;
    }
    f64::from(x) / 2_f64.powi(32)
}

pub fn direction(i: u32) -> DVec3 {
    let z = 2.0 * random(i, 1) - 1.0;
    let (sin, cos) = (std::f64::consts::TAU * random(i, 2)).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * cos, r * sin, z)
}

pub const SIZES: [[u32; 2]; 4] = [[1, 1], [1, 7], [31, 17], [127, 89]];

/// A projection and how to place a camera with it.
pub struct Case {
    pub name: &'static str,
    pub projection: DMat4,
    /// Distances from the eye plane to try, within the depth range.
    pub distances: [f64; 2],
    pub left_handed: bool,
    /// Said outright with `with_reversed_depth`.
    pub reversed: Option<bool>,
    pub eye: DVec3,
    pub up: DVec3,
    /// Left and top of the viewport.
    pub corner: [u32; 2],
    /// Where the positions' origin is, from the eye.
    pub origin: DVec3,
    /// Depth steps are too small to matter: positions are exact to f32.
    pub exact: bool,
}

impl Case {
    pub fn new(name: &'static str, projection: DMat4) -> Self {
        Self {
            name,
            projection,
            distances: [0.11, 90.0],
            left_handed: false,
            reversed: None,
            eye: DVec3::new(1.5, -0.7, 2.0),
            up: DVec3::Y,
            corner: [0, 0],
            origin: DVec3::ZERO,
            exact: false,
        }
    }

    pub fn camera(&self, [width, height]: [u32; 2]) -> Camera {
        let [x, y] = self.corner;
        let viewport = Viewport {
            x,
            y,
            width,
            height,
        };
        let forward = DVec3::new(0.6, 0.1, -0.9).normalize();
        let right = forward.cross(self.up).normalize();
        let up = right.cross(forward);
        let z = if self.left_handed { forward } else { -forward };
        let rotation = DMat3::from_cols(right, up, z).transpose();
        let view = DMat4::from_mat3(rotation) * DMat4::from_translation(-self.eye);
        let camera = Camera::new(view, self.projection, viewport).expect(self.name);
        match self.reversed {
            Some(reversed) => camera.with_reversed_depth(reversed),
            None => camera,
        }
    }

    /// The point that a pixel shows at a distance from the eye plane, relative to the eye, from the projection's rows
    /// alone: x and y do not mix in them.
    pub fn point(&self, camera: &Camera, x: f64, y: f64, distance: f64) -> DVec3 {
        let viewport = camera.viewport();
        let z = if self.left_handed {
            distance
        } else {
            -distance
        };
        let p = &self.projection;
        let w = p.z_axis.w * z + p.w_axis.w;
        let ndc = DVec2::new(
            x / f64::from(viewport.width) * 2.0 - 1.0,
            1.0 - y / f64::from(viewport.height) * 2.0,
        );
        let across = ndc * w - p.z_axis.truncate().truncate() * z - p.w_axis.truncate().truncate();
        let view = DVec3::new(across.x / p.x_axis.x, across.y / p.y_axis.y, z);
        camera.rotation().transpose() * view
    }

    pub fn distance(&self, i: u32) -> f64 {
        let [near, far] = self.distances;
        near * (far / near).powf(random(i, 3))
    }
}

pub fn cases() -> Vec<Case> {
    let aspect = 1.3;
    let fov = FRAC_PI_3;
    let reversed = right::perspective_infinite_reverse(fov, aspect, 0.1);
    let off_axis = {
        let mut p = reversed;
        p.z_axis.x = 0.7;
        p.z_axis.y = -0.4;
        p
    };
    let ortho = |near, far| right::orthographic(-4.0, 5.0, -3.0, 2.0, near, far);
    let ortho_lh = |near, far| left::orthographic(-4.0, 5.0, -3.0, 2.0, near, far);
    let case = Case::new;
    vec![
        case("forward", right::perspective(fov, aspect, 0.1, 100.0)),
        case("reversed", right::perspective(fov, aspect, 100.0, 0.1)),
        Case {
            exact: true,
            ..case("reversed, infinite", reversed)
        },
        case(
            "forward, infinite",
            right::perspective_infinite(fov, aspect, 0.1),
        ),
        case("forward orthographic", ortho(0.1, 100.0)),
        case("reversed orthographic", ortho(100.0, 0.1)),
        Case {
            left_handed: true,
            reversed: Some(false),
            ..case("left-handed forward orthographic", ortho_lh(0.1, 100.0))
        },
        Case {
            left_handed: true,
            reversed: Some(true),
            ..case("left-handed reversed orthographic", ortho_lh(100.0, 0.1))
        },
        Case {
            left_handed: true,
            ..case("left-handed", left::perspective(fov, aspect, 0.1, 100.0))
        },
        Case {
            left_handed: true,
            exact: true,
            ..case(
                "left-handed, reversed, infinite",
                left::perspective_infinite_reverse(fov, aspect, 0.1),
            )
        },
        Case {
            exact: true,
            ..case("off-axis", off_axis)
        },
        Case {
            up: DVec3::new(0.8, 0.5, 0.1),
            exact: true,
            ..case("rolled", reversed)
        },
        Case {
            corner: [5, 3],
            exact: true,
            ..case("a part of a texture", reversed)
        },
        Case {
            eye: DVec3::new(1e5, -2e5, 7e4),
            exact: true,
            ..case("far from the world's origin", reversed)
        },
        Case {
            origin: DVec3::new(0.03, 0.0, -0.01),
            exact: true,
            ..case("beside the cloud's eye", reversed)
        },
        Case {
            distances: [1.1e-3, 9e5],
            ..case(
                "near 1e-3, far 1e6",
                right::perspective(fov, aspect, 1e-3, 1e6),
            )
        },
        Case {
            distances: [1.1e-3, 9e5],
            exact: true,
            ..case(
                "near 1e-3, reversed, infinite",
                right::perspective_infinite_reverse(fov, aspect, 1e-3),
            )
        },
        Case {
            distances: [1e-6, 1e-2],
            exact: true,
            ..case(
                "scale 1e-4",
                right::perspective_infinite_reverse(fov, aspect, 1e-7),
            )
        },
        Case {
            distances: [1e4, 1e8],
            exact: true,
            ..case(
                "scale 1e5",
                right::perspective_infinite_reverse(fov, aspect, 1e4),
            )
        },
    ]
}

/// Whether a GPU's receiver is where it should be.
#[track_caller]
pub fn assert_receiver(
    decoder: &Decoder<'_>,
    found: Option<Receiver>,
    pixel: [u32; 2],
    depth: f64,
    texel: DVec3,
    exact: bool,
    inputs: &str,
) {
    let inputs = format!("{inputs}, pixel {pixel:?}, depth {depth}, normal {texel}");
    let expected = decoder.prepare(pixel, depth, texel);
    let (Some(found), Some(expected)) = (found, expected) else {
        assert_eq!(
            found.is_some(),
            expected.is_some(),
            "{inputs}: {found:?}, mirror {expected:?}"
        );
        return;
    };
    let eye = decoder.camera.eye() - decoder.origin;
    // Some roundings of f32 (6e-8 each) in a product of three.
    let mut tolerance = 1e-6 * (expected.position - eye).length();
    if !exact {
        // A unit in the last place of the depth, or of its fixed-point format: what the lift off the surface may be
        // rounded to.
        let step = match decoder.depth_format {
            Format::Depth16Unorm => 1.0 / 65535.0,
            Format::Depth24Plus | Format::Depth24PlusStencil8 => 1.0 / 16_777_215.0,
            _ => 1.2e-7 * depth,
        };
        let at = |depth| {
            decoder
                .unproject(pixel, depth)
                .unwrap_or(expected.position - eye)
        };
        tolerance += 2.0 * at(depth + step).distance(at(depth - step));
        if !decoder.camera.is_perspective() {
            // Depth is linear: f32 resolves a share of the range.
            tolerance += 1e-6 * 100.0;
        }
    }
    assert!(
        found.position.distance(expected.position) <= tolerance,
        "{inputs}: {} is off {} by {}, allowed {tolerance}",
        found.position,
        expected.position,
        found.position.distance(expected.position)
    );
    // Half a step of 16-bit snorm in each octahedral coordinate, which stretches by up to 2.
    assert!(
        found.normal.distance(expected.normal) <= 1e-4,
        "{inputs}: normal {}, mirror {}",
        found.normal,
        expected.normal
    );
}
