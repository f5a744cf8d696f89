//! One triangle and the test of a line against it.

use glam::{DVec3, Vec3};

use super::Hit;

/// A triangle with an area.
#[derive(Clone, Copy)]
pub(super) struct Triangle {
    /// Kept in `f32`, as given: the test widens them without loss, and half the memory is read.
    corners: [Vec3; 3],
    /// Its place in the caller's list.
    index: u32,
}

impl Triangle {
    /// Reads a face of a mesh, or nothing if it is not a triangle with an area.
    pub(super) fn new(positions: &[[f32; 3]], face: [u32; 3], index: u32) -> Option<Self> {
        let mut corners = [Vec3::ZERO; 3];
        for (corner, vertex) in corners.iter_mut().zip(face) {
            *corner = Vec3::from(*positions.get(vertex as usize)?);
        }
        let triangle = Self { corners, index };
        let [a, b, c] = triangle.corners();
        let has_area = (b - a).cross(c - a) != DVec3::ZERO;
        let is_finite = corners.iter().all(|corner| corner.is_finite());
        (is_finite && has_area).then_some(triangle)
    }

    /// Its place in the caller's list.
    pub(super) fn index(&self) -> usize {
        self.index as usize
    }

    pub(super) fn corners(&self) -> [DVec3; 3] {
        self.corners.map(|corner: Vec3| DVec3::from(corner))
    }

    /// The unit normal of the front side, from which the corners run counter-clockwise.
    pub(super) fn normal(&self) -> DVec3 {
        let [a, b, c] = self.corners();
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// The longest side of its bounding box.
    pub(super) fn extent(&self) -> f64 {
        let [a, b, c] = self.corners();
        (a.max(b).max(c) - a.min(b).min(c)).max_element()
    }

    /// How far a point is from its plane.
    pub(super) fn plane_distance(&self, point: DVec3) -> f64 {
        self.normal().dot(point - self.corners()[0]).abs()
    }

    /// The place of a hit.
    pub(super) fn at(&self, hit: &Hit) -> DVec3 {
        let [a, b, c] = self.corners();
        let [v, w] = hit.barycentric;
        a + (b - a) * v + (c - a) * w
    }

    /// Where a line meets the triangle, in front of the line's origin or behind.
    pub(super) fn meet(&self, line: &Line) -> Option<Hit> {
        let [a, b, c] = self.corners().map(|corner| line.project(corner));
        let u = b.perp_dot(c);
        let v = c.perp_dot(a);
        let w = a.perp_dot(b);
        let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
        let area = u + v + w;
        if !inside || area == 0.0 {
            return None;
        }
        let [u, v, w] = [u, v, w].map(|part| part / area);
        Some(Hit {
            // By the corners and not by the plane: the distance then lies between the corners'
            // even when the line grazes the triangle.
            t: u * a.t + v * b.t + w * c.t,
            triangle: self.index as usize,
            barycentric: [v, w],
        })
    }
}

/// A line that triangles are tested against: the shear of Woop, Benthin and Wald, "Watertight
/// Ray/Triangle Intersection", 2013.
///
/// Corners are projected along the line onto a plane across it, where the line is the origin and
/// the test is whether the triangle surrounds it. A corner has the same projection in every
/// triangle it belongs to, and two triangles compute the area that their shared edge spans with
/// the origin with opposite signs to the last bit. An area of zero counts as inside for both, so
/// no ray slips between them.
pub(super) struct Line {
    origin: DVec3,
    /// The axis the direction is longest along, last, and the other two.
    axes: [usize; 3],
    /// The direction's components on the other two, by that on the last.
    shear: [f64; 2],
    /// The direction's component on the last axis.
    along: f64,
}

impl Line {
    /// The line through `origin` along the unit vector `direction`.
    pub(super) fn new(origin: DVec3, direction: DVec3) -> Self {
        let last = direction.abs().max_position();
        let axes = [(last + 1) % 3, (last + 2) % 3, last];
        let along = direction[last];
        Self {
            origin,
            axes,
            shear: [direction[axes[0]] / along, direction[axes[1]] / along],
            along,
        }
    }

    fn project(&self, corner: DVec3) -> Projection {
        let offset = corner - self.origin;
        let [x, y, z] = self.axes.map(|axis| offset[axis]);
        Projection {
            x: x - self.shear[0] * z,
            y: y - self.shear[1] * z,
            t: z / self.along,
        }
    }
}

/// A corner seen along a line.
#[derive(Clone, Copy)]
struct Projection {
    /// Across the line.
    x: f64,
    y: f64,
    /// Distance along the line.
    t: f64,
}

impl Projection {
    /// Twice the signed area of the triangle with the origin.
    fn perp_dot(self, other: Self) -> f64 {
        self.x * other.y - self.y * other.x
    }
}
