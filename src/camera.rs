//! What a pass knows of the camera: where it stands, how it projects, and which rectangle of the texture it fills.
//!
//! # Spaces
//! * **World**: the caller's, in f64 on the CPU.
//! * **Eye space**: axes of the world, origin at a camera's eye. All positions on the GPU are in the eye space of the
//!   camera that a [`SurfelCloud`](crate::SurfelCloud) was made for, so that a scene 1e5 units from the world's origin
//!   keeps the precision of one at the origin.
//! * **NDC**: x right, y up, depth 0…1 (wgpu's).
//!
//! # Depth
//! The convention (forward, reversed, infinite, orthographic) is read off the projection matrix: background is the
//! depth value that lies farther away, 0 or 1. A depth at or beyond it is sky.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};

use crate::error::Error;

/// A rectangle of a texture, in pixels, origin at the top left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Viewport {
    /// Left edge.
    pub x: u32,
    /// Top edge.
    pub y: u32,
    /// Width, at least 1.
    pub width: u32,
    /// Height, at least 1.
    pub height: u32,
}

impl Viewport {
    /// The whole of a texture of this size.
    pub const fn full(width: u32, height: u32) -> Self {
        Self {
            x: 0,
            y: 0,
            width,
            height,
        }
    }

    /// One past the right-most and lowest pixel.
    pub(crate) const fn end(&self) -> [u32; 2] {
        [
            self.x.saturating_add(self.width),
            self.y.saturating_add(self.height),
        ]
    }
}

/// A camera, checked when it is made.
///
/// Any rigid (or mirrored) view and any invertible perspective or orthographic projection to wgpu's NDC will do:
/// forward or reversed depth, finite or infinite far plane, off-axis, rolled. Row 0 of the viewport is its top.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    eye: DVec3,
    /// World axes to view axes.
    rotation: DMat3,
    projection: DMat4,
    viewport: Viewport,
    perspective: bool,
    /// The depth value of the background: 0 or 1.
    far_depth: f64,
    /// Distance of the near plane from the eye plane, world units; 0 for an orthographic camera.
    near: f64,
    /// Inverse projection for `(ndc.x, ndc.y, depth - far_depth, 1)`, into eye space.
    unproject: DMat4,
}

impl Camera {
    /// A camera from its matrices. `view` takes world to view space, `projection` view to clip space with depth 0…1.
    ///
    /// f64, since a view matrix in f32 has lost the eye's position far from the origin; convert one with
    /// [`glam::Mat4::as_dmat4`].
    ///
    /// # Errors
    /// [`Error::Camera`] where the view scales or shears, where the projection is singular, not finite or neither
    /// perspective nor orthographic, and where the viewport is empty.
    pub fn new(view: DMat4, projection: DMat4, viewport: Viewport) -> Result<Self, Error> {
        let refuse = |field, value: String, accepted| {
            Err(Error::Camera {
                field,
                value,
                accepted,
            })
        };
        let rotation = DMat3::from_mat4(view);
        let rigid = (rotation * rotation.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-3);
        let affine = view.row(3) == DVec4::W;
        if !(view.is_finite() && rigid && affine) {
            return refuse(
                "view",
                format!("{view}"),
                "a finite rotation (or reflection) and translation",
            );
        }
        if viewport.width == 0 || viewport.height == 0 {
            return refuse(
                "viewport",
                format!("{}x{}", viewport.width, viewport.height),
                "at least 1x1",
            );
        }
        let last = projection.row(3);
        let scale = last.abs().max_element();
        let is = |v: f64| v.abs() > 1e-9 * scale;
        let perspective = is(last.z) && !is(last.x) && !is(last.y) && !is(last.w);
        let orthographic = is(last.w) && !is(last.x) && !is(last.y) && !is(last.z);
        let inverse = projection.inverse();
        if !(projection.is_finite() && inverse.is_finite() && (perspective || orthographic)) {
            return refuse(
                "projection",
                format!("{projection}"),
                "finite, invertible, perspective or orthographic",
            );
        }

        // Distance from the eye plane at both ends of the depth range; infinite where w is 0 there.
        let distance_at = |depth: f64| {
            let h = inverse * DVec4::new(0.0, 0.0, depth, 1.0);
            if h.w == 0.0 {
                f64::INFINITY
            } else {
                let z = h.z / h.w;
                // Beyond infinity: some matrices put their far plane past w = 0 by a rounding.
                if perspective && z * last.z < 0.0 {
                    f64::INFINITY
                } else if perspective {
                    z.abs()
                } else {
                    // A right-handed view looks down -z; `with_reversed_depth` serves the other kind.
                    -z
                }
            }
        };
        let (at_zero, at_one) = (distance_at(0.0), distance_at(1.0));
        let mut camera = Self {
            eye: -(rotation.transpose() * view.w_axis.truncate()),
            rotation,
            projection,
            viewport,
            perspective,
            far_depth: 0.0,
            near: if perspective {
                at_zero.min(at_one)
            } else {
                0.0
            },
            unproject: DMat4::IDENTITY,
        };
        camera.set_far_depth(if at_zero > at_one { 0.0 } else { 1.0 });
        Ok(camera)
    }

    /// A camera at `eye` that looks at `target`, right-handed (view space looks down −z).
    ///
    /// # Errors
    /// As [`Camera::new`]; a target at the eye, or `up` along the viewing direction, gives a view that is not finite.
    pub fn look_at(
        eye: DVec3,
        target: DVec3,
        up: DVec3,
        projection: DMat4,
        viewport: Viewport,
    ) -> Result<Self, Error> {
        // The translation is applied apart from the rotation: glam's look_at would round the eye through a product.
        let forward = (target - eye).normalize_or_zero();
        let right = forward.cross(up).normalize_or_zero();
        let rotation = DMat3::from_cols(right, right.cross(forward), -forward).transpose();
        let view = DMat4::from_mat3(rotation) * DMat4::from_translation(-eye);
        let mut camera = Self::new(view, projection, viewport)?;
        camera.eye = eye;
        Ok(camera)
    }

    /// The eye's position in the world.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// The rectangle of the textures that this camera fills.
    pub fn viewport(&self) -> Viewport {
        self.viewport
    }

    /// The depth value of the background: 0 for reversed depth, 1 for forward depth.
    pub fn background_depth(&self) -> f32 {
        self.far_depth as f32
    }

    /// View to clip space, as given.
    pub fn projection(&self) -> DMat4 {
        self.projection
    }

    /// World axes to view axes.
    pub fn rotation(&self) -> DMat3 {
        self.rotation
    }

    /// Whether the projection is a perspective one.
    pub fn is_perspective(&self) -> bool {
        self.perspective
    }

    /// The same camera with its depth convention said outright: `true` where nearer is larger.
    ///
    /// Only needed for an orthographic projection of a left-handed view space: its matrix looks like that of a
    /// right-handed one with the depth reversed, which is what is assumed.
    #[must_use]
    pub fn with_reversed_depth(mut self, reversed: bool) -> Self {
        self.set_far_depth(if reversed { 0.0 } else { 1.0 });
        self
    }

    fn set_far_depth(&mut self, far_depth: f64) {
        self.far_depth = far_depth;
        // Expanding about the far end keeps what a matrix inverted in f32 would lose: w is tiny there.
        self.unproject = DMat4::from_mat3(self.rotation.transpose())
            * self.projection.inverse()
            * DMat4::from_translation(DVec3::new(0.0, 0.0, far_depth));
    }

    /// How large a pixel is in the scene.
    pub fn footprint(&self) -> Footprint {
        // Only the part across the axis: an off-axis projection carries its shear in the rows' z.
        let across = |row: usize, pixels: u32| {
            2.0 / (self.projection.row(row).truncate().truncate().length() * f64::from(pixels))
        };
        let last = self.projection.row(3);
        let per_unit = if self.perspective { last.z } else { last.w };
        Footprint {
            pixel: (across(0, self.viewport.width) * across(1, self.viewport.height)).sqrt()
                * per_unit.abs(),
            near: self.near,
            perspective: self.perspective,
        }
    }

    /// The point in eye space that a pixel of the viewport shows, `None` for the sky. `x` and `y` are in pixels from
    /// the viewport's top left corner; a pixel's centre is at its index plus one half.
    pub fn unproject(&self, x: f64, y: f64, depth: f64) -> Option<DVec3> {
        if !self.is_foreground(depth) {
            return None;
        }
        let h = self.unproject
            * DVec4::new(
                x / f64::from(self.viewport.width) * 2.0 - 1.0,
                1.0 - y / f64::from(self.viewport.height) * 2.0,
                depth - self.far_depth,
                1.0,
            );
        let p = h.truncate() / h.w;
        (h.w > 0.0 && p.is_finite()).then_some(p)
    }

    /// Pixel coordinates in the viewport and depth of a point in eye space; `None` on or behind the eye's plane.
    pub fn project(&self, point: DVec3) -> Option<DVec3> {
        let clip = self.projection * (self.rotation * point).extend(1.0);
        if clip.w <= 0.0 || !clip.is_finite() {
            return None;
        }
        let ndc = clip.truncate() / clip.w;
        Some(DVec3::new(
            (ndc.x + 1.0) * 0.5 * f64::from(self.viewport.width),
            (1.0 - ndc.y) * 0.5 * f64::from(self.viewport.height),
            ndc.z,
        ))
    }

    /// Unit vector along the axis, away from the camera: what distances from its eye's plane grow along.
    pub(crate) fn axis(&self) -> DVec3 {
        let axis = if self.perspective {
            // The clip space's w.
            self.rotation.transpose() * self.projection.row(3).truncate()
        } else {
            let deeper = self.unproject.z_axis.truncate();
            if self.far_depth == 0.0 {
                -deeper
            } else {
                deeper
            }
        };
        axis.normalize_or_zero()
    }

    /// Whether a depth value is nearer than the background.
    fn is_foreground(&self, depth: f64) -> bool {
        if self.far_depth == 0.0 {
            depth > 0.0
        } else {
            depth < 1.0
        }
    }

    /// Unit vector along which depth grows, in the world.
    pub(crate) fn forward(&self) -> DVec3 {
        if self.perspective {
            let side = self.projection.row(3).z.signum();
            self.rotation.transpose() * DVec3::new(0.0, 0.0, side)
        } else {
            // Depth grows away from an orthographic camera, unless it is reversed.
            let away = if self.far_depth == 0.0 { -1.0 } else { 1.0 };
            (self.unproject.z_axis.truncate() * away).normalize()
        }
    }

    /// Takes points in eye space to pixels of the viewport: `(x w, y w, w, 0)`.
    pub(crate) fn pixel_matrix(&self) -> DMat4 {
        let clip = self.projection * DMat4::from_mat3(self.rotation);
        let w = clip.row(3);
        let half = 0.5 * DVec2::new(self.viewport.width.into(), self.viewport.height.into());
        let x = half.x * (w + clip.row(0));
        let y = half.y * (w - clip.row(1));
        DMat4::from_cols(x, y, w, DVec4::ZERO).transpose()
    }

    /// Takes `(x, y, depth - far_depth, 1)`, x and y in pixels of the viewport, to homogeneous points in eye space.
    pub(crate) fn unpixel_matrix(&self) -> DMat4 {
        let size = DVec3::new(self.viewport.width.into(), self.viewport.height.into(), 1.0);
        self.unproject
            * DMat4::from_translation(DVec3::new(-1.0, 1.0, 0.0))
            * DMat4::from_scale(DVec3::new(2.0, -2.0, 1.0) / size)
    }

    /// Planes `(normal, offset)` in the eye space of `origin`, normals inward: a visible point `p` has
    /// `dot(normal, p) + offset >= 0` for all of them. A plane at infinity accepts all.
    pub(crate) fn frustum(&self, origin: DVec3) -> [DVec4; 6] {
        let clip = self.projection * DMat4::from_mat3(self.rotation);
        let w = clip.row(3);
        let shift = self.eye - origin;
        [
            w + clip.row(0),
            w - clip.row(0),
            w + clip.row(1),
            w - clip.row(1),
            clip.row(2),
            w - clip.row(2),
        ]
        .map(|plane| {
            let length = plane.truncate().length();
            // A far plane at infinity has no direction: its row is (0, 0, 0, near).
            if length <= 1e-12 * plane.w.abs() {
                return DVec4::new(0.0, 0.0, 0.0, f64::from(f32::MAX));
            }
            let n = plane / length;
            n.truncate().extend(n.w - n.truncate().dot(shift))
        })
    }

    /// What the shaders read, for positions in the eye space of `origin`.
    pub(crate) fn params(&self, origin: DVec3) -> CameraParams {
        let footprint = self.footprint();
        let rotation = self.rotation.transpose();
        let axis = |v: DVec3| v.extend(0.0).as_vec4().to_array();
        CameraParams {
            unproject: self.unproject.as_mat4().to_cols_array_2d(),
            view_to_world: [
                axis(rotation.x_axis),
                axis(rotation.y_axis),
                axis(rotation.z_axis),
            ],
            eye: (self.eye - origin).as_vec3().to_array(),
            far_depth: self.far_depth as f32,
            viewport: [
                self.viewport.x,
                self.viewport.y,
                self.viewport.width,
                self.viewport.height,
            ],
            pixel: footprint.pixel as f32,
            near: footprint.near as f32,
            perspective: u32::from(self.perspective),
            padding: 0,
        }
    }
}

/// How large a pixel is in the scene: `pixel` world units a unit of distance for a perspective camera, `pixel` world
/// units everywhere for an orthographic one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Side of a pixel (geometric mean of width and height) at unit distance, or everywhere.
    pub pixel: f64,
    /// The near plane's distance: nothing nearer asks for finer detail.
    pub near: f64,
    /// Whether the footprint grows with distance.
    pub perspective: bool,
}

impl Footprint {
    /// Side of a pixel at a point in eye space, world units. Grows with the *Euclidean* distance: with the view depth
    /// of Deep Screen Space 3.1, surfaces beside the camera would be cut as finely as those on its near plane.
    pub fn at(&self, point: DVec3) -> f64 {
        if self.perspective {
            self.pixel * point.length().max(self.near)
        } else {
            self.pixel
        }
    }
}

/// `Camera` of `wgsl/common/camera.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct CameraParams {
    pub(crate) unproject: [[f32; 4]; 4],
    pub(crate) view_to_world: [[f32; 4]; 3],
    pub(crate) eye: [f32; 3],
    pub(crate) far_depth: f32,
    pub(crate) viewport: [u32; 4],
    pub(crate) pixel: f32,
    pub(crate) near: f32,
    pub(crate) perspective: u32,
    pub(crate) padding: u32,
}

impl CameraParams {
    /// What a pass over a sub-image alone knows of the camera: its pixels lie from the corner and are larger. Its points are
    /// not to be unprojected.
    pub(crate) fn of_sub_image(mut self, [width, height]: [u32; 2], level: u32) -> Self {
        self.viewport = [0, 0, width, height];
        self.pixel *= (1_u32 << level) as f32;
        self
    }
}
