//! What a pass knows of the camera: where it stands, how it projects, and which rectangle of the texture it fills.
//!
//! # Spaces
//! * **World**: the caller's, in f64 on the CPU.
//! * **Eye space**: axes of the world, origin at a camera's eye.
//! * **Focus space**: axes of the world, origin at a camera's [focus](Camera::focus), a point near what it sees. All
//!   positions on the GPU are in that of the camera that a [`SurfelCloud`](crate::SurfelCloud) was made for, so that a
//!   scene far from the world's origin, or from the eye, keeps the precision of one at the origin.
//! * **NDC**: x right, y up, depth 0…1 (wgpu's).
//!
//! # Depth
//! The convention (forward, reversed, infinite, orthographic) is read off the projection matrix: background is the
//! depth value that lies farther away, 0 or 1. A depth at or beyond it is sky.
//!
//! # Precision
//! Positions are rounded relative to their distance from the focus, and rays start off surfaces by some such roundings.
//! What the depth buffer itself cannot tell apart is lost before: an orthographic camera's depth of 32 bits has steps of
//! 6e-8 of the depth range, a perspective one's of 6e-8 of the distance times what the near plane leaves of it
//! (distance / near, with forward depth). So far from the scene, near and far planes should enclose it: with them right
//! around a room of 5 units, rays are as good from 1e6 away with an orthographic camera, and from 1e5 with a narrow
//! perspective one, as from within. Where the near plane cannot be near the scene, [`Camera::with_focus`] says where it is,
//! and reversed depth in 32-bit floats resolves it.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};

use crate::error::{Error, check_setting};

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
    /// The least distance of what the near plane leaves in the picture from the eye plane, world units; 0 for an
    /// orthographic camera.
    near: f64,
    /// What positions on the GPU are relative to.
    focus: DVec3,
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
    /// perspective nor orthographic, where its near plane leaves nothing of the picture, and where the viewport is empty.
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

        // Along a line of sight the inverse of the view depth is linear in the depth, and grows towards the eye: that of a
        // perspective camera is the homogeneous coordinate, that of an orthographic one the coordinate behind it. A
        // right-handed view looks down -z; `with_reversed_depth` serves the other kind.
        let reversed = if perspective {
            inverse.z_axis.w > 0.0
        } else {
            inverse.z_axis.z / inverse.w_axis.w > 0.0
        };
        let near_depth = if reversed { 1.0 } else { 0.0 };
        // An oblique near plane is nearest in a corner of the picture, and may lie behind the eye in others: nothing is
        // seen there.
        let nearest = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)]
            .map(|(x, y)| inverse.row(3).dot(DVec4::new(x, y, near_depth, 1.0)))
            .into_iter()
            .fold(f64::NEG_INFINITY, f64::max);
        if perspective && nearest <= 0.0 {
            return refuse(
                "projection",
                format!("{projection}"),
                "a near plane before the eye, somewhere in the picture",
            );
        }
        let mut camera = Self {
            eye: -(rotation.transpose() * view.w_axis.truncate()),
            rotation,
            projection,
            viewport,
            perspective,
            far_depth: 0.0,
            near: if perspective {
                1.0 / (nearest * last.z.abs())
            } else {
                0.0
            },
            focus: DVec3::ZERO,
            unproject: DMat4::IDENTITY,
        };
        camera.set_far_depth(1.0 - near_depth);
        camera.focus = camera.eye + camera.default_focus();
        Ok(camera)
    }

    /// The same from plain arrays of f64 or f32, column by column, for engines on another version of [`glam`], or on none.
    ///
    /// ```
    /// use deep_screen_space::{Camera, Viewport};
    ///
    /// // An engine's matrices, in f32: 4 units behind the origin, 90° wide and high, depth from 1 at 0.1 units to 0 far away.
    /// let view = [[1.0_f32, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, -4.0, 1.0]];
    /// let projection = [[1.0_f32, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, -1.0], [0.0, 0.0, 0.1, 0.0]];
    /// let widened = |columns: [[f32; 4]; 4]| columns.map(|column| column.map(f64::from));
    /// let camera = Camera::from_arrays(widened(view), widened(projection), Viewport::full(512, 512))?;
    /// assert_eq!(camera.eye().to_array(), [0.0, 0.0, 4.0]);
    /// assert_eq!(camera.background_depth(), 0.0);
    /// # Ok::<(), deep_screen_space::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn from_arrays<T: Into<f64>>(
        view: [[T; 4]; 4],
        projection: [[T; 4]; 4],
        viewport: Viewport,
    ) -> Result<Self, Error> {
        let [view, projection] = [view, projection]
            .map(|m| DMat4::from_cols_array_2d(&m.map(|column| column.map(Into::into))));
        Self::new(view, projection, viewport)
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
        camera.focus = eye + camera.default_focus();
        Ok(camera)
    }

    /// The eye's position in the world.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// The point in the world that positions on the GPU are relative to: they are rounded relative to their distance from it.
    ///
    /// That of a perspective camera lies before its eye as far as its near plane, that of an orthographic one, whose eye
    /// may be anywhere along its axis, in the middle of what it sees; unless [`Camera::with_focus`] says otherwise.
    pub fn focus(&self) -> DVec3 {
        self.focus
    }

    /// The same camera with another focus: a point among what it sees, where that is far from its near plane and small
    /// against the distance. The picture is the same but for roundings.
    ///
    /// # Errors
    /// [`Error::Camera`] where it is not finite.
    pub fn with_focus(mut self, focus: DVec3) -> Result<Self, Error> {
        if !focus.is_finite() {
            return Err(Error::Camera {
                field: "focus",
                value: format!("{focus}"),
                accepted: "finite",
            });
        }
        self.focus = focus;
        Ok(self)
    }

    /// Relative to the eye.
    fn default_focus(&self) -> DVec3 {
        if self.perspective {
            return self.forward() * self.near;
        }
        // The middle of the depth range on the middle line of sight.
        let middle = self.unproject * DVec4::new(0.0, 0.0, 0.5 - self.far_depth, 1.0);
        middle.truncate() / middle.w
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

    /// The line of sight through a place of the viewport, in pixels from its top left corner: where it passes the eye's plane,
    /// relative to the eye, and its direction, 1 long along the axis.
    pub fn line_of_sight(&self, x: f64, y: f64) -> (DVec3, DVec3) {
        let axis = self.axis();
        let h = self.unproject
            * DVec4::new(
                x / f64::from(self.viewport.width) * 2.0 - 1.0,
                1.0 - y / f64::from(self.viewport.height) * 2.0,
                0.0,
                1.0,
            );
        if self.perspective {
            // Homogeneous points of a perspective camera are their line's direction, whatever the depth.
            let direction = h.truncate();
            return (DVec3::ZERO, direction / axis.dot(direction));
        }
        let p = h.truncate() / h.w;
        (p - axis * axis.dot(p), axis)
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

    /// How far the focus is from the eye along the axis.
    #[cfg(feature = "reference")]
    pub(crate) fn focus_depth(&self) -> f64 {
        self.axis().dot(self.focus - self.eye)
    }

    /// What grows by this for each unit of depth, along any line of sight: the view depth of an orthographic camera, one over
    /// it of another. Negative where nearer is larger, or smaller for the latter.
    pub(crate) fn linear_slope(&self) -> f64 {
        if self.perspective {
            self.unproject.z_axis.w * self.projection.row(3).z.abs()
        } else {
            self.axis().dot(self.unproject.z_axis.truncate()) / self.unproject.w_axis.w
        }
    }

    /// How depth at one distance along the axis changes with x and y of NDC: not at all unless the near plane is oblique.
    pub(crate) fn tilt(&self) -> DVec2 {
        let [x, y, depth] = [0, 1, 2].map(|i| {
            let column = self.unproject.col(i);
            if self.perspective {
                column.w
            } else {
                self.axis().dot(column.truncate())
            }
        });
        let tilt = -DVec2::new(x, y) / depth;
        // In an ordinary matrix that is the rounding of its inverse.
        DVec2::select(tilt.abs().cmpgt(DVec2::splat(1e-12)), tilt, DVec2::ZERO)
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

    /// Takes points relative to `origin` to clip space.
    pub(crate) fn clip_matrix(&self, origin: DVec3) -> DMat4 {
        self.projection
            * DMat4::from_mat3(self.rotation)
            * DMat4::from_translation(origin - self.eye)
    }

    /// Takes points relative to `origin` to pixels of the viewport: `(x w, y w, w, 0)`.
    pub(crate) fn pixel_matrix(&self, origin: DVec3) -> DMat4 {
        let clip = self.clip_matrix(origin);
        let w = clip.row(3);
        let half = 0.5 * DVec2::new(self.viewport.width.into(), self.viewport.height.into());
        let x = half.x * (w + clip.row(0));
        let y = half.y * (w - clip.row(1));
        DMat4::from_cols(x, y, w, DVec4::ZERO).transpose()
    }

    /// Takes what [`CameraParams::unproject`] does, with x and y in pixels of the viewport in place of NDC, to the same.
    pub(crate) fn unpixel_matrix(&self, origin: DVec3) -> DMat4 {
        let size = DVec3::new(self.viewport.width.into(), self.viewport.height.into(), 1.0);
        self.unproject_matrix(origin).0
            * DMat4::from_translation(DVec3::new(-1.0, 1.0, 0.0))
            * DMat4::from_scale(DVec3::new(2.0, -2.0, 1.0) / size)
    }

    /// [`CameraParams::unproject`] for positions relative to `origin`, and its reference.
    fn unproject_matrix(&self, origin: DVec3) -> (DMat4, f32) {
        // The depth that the origin would have on the middle line of sight, or the nearest one that a buffer can hold.
        // Positions there are the matrix' constants, so that nothing cancels near the origin.
        let away = self.axis().dot(origin - self.eye);
        let (middle, slope) = (self.unproject.w_axis, self.unproject.z_axis);
        let offset = if self.perspective {
            (self.projection.row(3).z.abs() * away).recip() - middle.w
        } else {
            self.axis()
                .dot(origin - self.eye - middle.truncate() / middle.w)
                * middle.w
        };
        let per_depth = if self.perspective {
            slope.w
        } else {
            self.axis().dot(slope.truncate())
        };
        let depth = self.far_depth + offset / per_depth;
        let reference = if depth.is_finite() && (!self.perspective || away > 0.0) {
            depth.clamp(0.0, 1.0) as f32
        } else {
            1.0 - self.far_depth as f32
        };
        let moved = DMat4::from_translation(self.eye - origin)
            * self.unproject
            * DMat4::from_translation(DVec3::new(0.0, 0.0, f64::from(reference) - self.far_depth));
        let mut matrix = moved;
        matrix.w_axis.w = self.unproject.w_axis.w;
        (matrix, reference)
    }

    /// The lines of sight, for positions relative to `origin`.
    pub(crate) fn rays(&self, origin: DVec3) -> RayParams {
        let to_eye = self.eye - origin;
        let columns = |m: [DVec3; 3]| m.map(|column| column.extend(0.0).as_vec4().to_array());
        let [x, y, _, w] = [0, 1, 2, 3].map(|i| self.unproject.col(i).truncate());
        let axis = self.axis();
        // From where a line passes the plane across the axis through the origin.
        if self.perspective {
            // Homogeneous points of a perspective camera are their line's direction, whatever the depth.
            let scale = axis.dot(w).recip();
            let away = -axis.dot(to_eye);
            let direction = [x * scale, y * scale, w * scale];
            let base = [
                direction[0] * away,
                direction[1] * away,
                direction[2] * away + to_eye,
            ];
            return RayParams {
                base: columns(base),
                direction: columns(direction),
            };
        }
        let scale = self.unproject.w_axis.w.recip();
        let across = |p: DVec3| p - axis * axis.dot(p);
        RayParams {
            base: columns([
                across(x * scale),
                across(y * scale),
                across(w * scale + to_eye),
            ]),
            direction: columns([DVec3::ZERO, DVec3::ZERO, axis]),
        }
    }

    /// Planes `(normal, offset)` relative to `origin`, normals inward: a visible point `p` has
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

    /// What the shaders read, for positions relative to `origin`.
    pub(crate) fn params(&self, origin: DVec3) -> CameraParams {
        let footprint = self.footprint();
        let rotation = self.rotation.transpose();
        let axis = |v: DVec3| v.extend(0.0).as_vec4().to_array();
        let (unproject, reference) = self.unproject_matrix(origin);
        CameraParams {
            unproject: unproject.as_mat4().to_cols_array_2d(),
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
            reference,
        }
    }
}

/// How large a pixel is in the scene: `pixel` world units a unit of distance for a perspective camera, `pixel` world
/// units everywhere for an orthographic one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Side of a pixel (geometric mean of width and height) at unit distance, or everywhere.
    pub pixel: f64,
    /// The near plane's distance where it is nearest in the picture: nothing nearer asks for finer detail.
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
    /// Takes `(ndc.x, ndc.y, depth - reference, 1)` to homogeneous points relative to the origin; but the homogeneous
    /// coordinate is of `depth - far_depth`, where it would cancel else.
    pub(crate) unproject: [[f32; 4]; 4],
    pub(crate) view_to_world: [[f32; 4]; 3],
    pub(crate) eye: [f32; 3],
    pub(crate) far_depth: f32,
    pub(crate) viewport: [u32; 4],
    pub(crate) pixel: f32,
    pub(crate) near: f32,
    pub(crate) perspective: u32,
    pub(crate) reference: f32,
}

crate::reflection::same_as_wgsl!(
    cameras_are_the_shaders: CameraParams as "Camera" in [
        "surfelizer", "receivers", "reconstructor smooth", "reconstructor",
        "temporal_accumulator", "bounced_z_buffer radiance glossy",
    ]
    { unproject, view_to_world, eye, far_depth, viewport, pixel, near, perspective, reference }
);

/// `Rays` of `wgsl/common/camera.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RayParams {
    pub(crate) base: [[f32; 4]; 3],
    pub(crate) direction: [[f32; 4]; 3],
}

crate::reflection::same_as_wgsl!(
    rays_are_the_shaders: RayParams as "Rays" in ["volumetric_obscurance", "sg_hull_segment"]
    { base, direction }
);

impl CameraParams {
    /// What a pass over a sub-image alone knows of the camera: its pixels lie from the corner and are larger. Its points are
    /// not to be unprojected.
    pub(crate) fn of_sub_image(mut self, [width, height]: [u32; 2], level: u32) -> Self {
        self.viewport = [0, 0, width, height];
        self.pixel *= (1_u32 << level) as f32;
        self
    }
}

/// [`Error::Setting`] for an origin that is not finite or so far off that positions leave the range of `f32`.
pub(crate) fn check_origin(field: &'static str, origin: DVec3) -> Result<(), Error> {
    const FARTHEST: f64 = 1e18;
    for value in origin.to_array() {
        check_setting(
            value.abs() < FARTHEST,
            field,
            value,
            "finite, nearer than 1e18 to the world's origin",
        )?;
    }
    Ok(())
}
