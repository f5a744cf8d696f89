//! How near the triangles are that a camera sees: where its near plane may be.

use deep_screen_space::{
    glam::{DMat3, DVec3},
    scenes::Scene,
};

/// A pyramid of sight without end.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    pub eye: DVec3,
    /// World axes to view axes: it looks down −z.
    pub rotation: DMat3,
    /// Tangents of the angles between its axis and its right and upper side.
    pub tangents: [f64; 2],
}

impl Sight {
    /// The least depth of a scene's triangles within the pyramid, 0 where one goes through the eye; `None` where there are
    /// none.
    pub fn least_depth(&self, scene: &Scene) -> Option<f64> {
        let views: Vec<DVec3> = scene
            .positions
            .iter()
            .map(|p| self.rotation * (DVec3::from(p.map(f64::from)) - self.eye))
            .collect();
        let mut least = f64::INFINITY;
        for corners in scene.indices.chunks_exact(3) {
            let corners = [0, 1, 2].map(|k| views[corners[k] as usize]);
            // Clipping is for the few that may be nearer than all before.
            if corners.iter().any(|c| -c.z < least) {
                least = least.min(self.least_of(corners));
            }
        }
        least.is_finite().then_some(least)
    }

    /// The least depth of a triangle in view space within the pyramid, infinite where it is outside.
    fn least_of(&self, corners: [DVec3; 3]) -> f64 {
        let [x, y] = self.tangents;
        // Inward, through the eye.
        let planes = [
            DVec3::new(0.0, 0.0, -1.0),
            DVec3::new(-1.0, 0.0, -x),
            DVec3::new(1.0, 0.0, -x),
            DVec3::new(0.0, -1.0, -y),
            DVec3::new(0.0, 1.0, -y),
        ];
        let outside = |plane: &DVec3| corners.iter().all(|c| plane.dot(*c) < 0.0);
        if planes.iter().any(outside) {
            return f64::INFINITY;
        }
        let mut polygon = corners.to_vec();
        for plane in planes {
            polygon = clip(&polygon, plane);
        }
        polygon
            .iter()
            .map(|c| -c.z)
            .fold(f64::INFINITY, f64::min)
            .max(0.0)
    }
}

/// The part of a convex polygon on the side of a plane through the origin that its normal points to.
fn clip(polygon: &[DVec3], plane: DVec3) -> Vec<DVec3> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, &end) in polygon.iter().enumerate() {
        let start = polygon[(i + polygon.len() - 1) % polygon.len()];
        let [from, to] = [plane.dot(start), plane.dot(end)];
        if (from < 0.0) != (to < 0.0) {
            kept.push(start.lerp(end, from / (from - to)));
        }
        if to >= 0.0 {
            kept.push(end);
        }
    }
    kept
}

/// The near plane of a light's camera at a point: before all triangles, and at `most`.
pub fn near_of(scene: &Scene, point: DVec3, most: f64) -> f64 {
    let before = distance(scene, point).map_or(most, |d| 0.5 * d);
    before.clamp(1e-6 * most, most)
}

/// The least distance of a scene's triangles from a point; `None` where it has none.
pub fn distance(scene: &Scene, point: DVec3) -> Option<f64> {
    let positions: Vec<DVec3> = scene
        .positions
        .iter()
        .map(|p| DVec3::from(p.map(f64::from)) - point)
        .collect();
    scene
        .indices
        .chunks_exact(3)
        .map(|corners| nearest([0, 1, 2].map(|k| positions[corners[k] as usize])))
        .min_by(f64::total_cmp)
}

/// Distance of a triangle from the origin.
fn nearest([a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a);
    // Inside of all three edges, the plane is nearest; elsewhere an edge.
    let inside = |p: DVec3, q: DVec3| normal.dot((q - p).cross(-p)) >= 0.0;
    if normal.length_squared() > 0.0 && inside(a, b) && inside(b, c) && inside(c, a) {
        return a.dot(normal.normalize()).abs();
    }
    let edge = |p: DVec3, q: DVec3| {
        let along = q - p;
        let t = (-p.dot(along) / along.length_squared()).clamp(0.0, 1.0);
        // An edge without length gives no number.
        if t.is_nan() {
            p.length()
        } else {
            (p + t * along).length()
        }
    };
    edge(a, b).min(edge(b, c)).min(edge(c, a))
}
