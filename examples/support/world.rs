//! A scene whose places are known in f64: of what is far from the origin, f32 would keep too little.

use deep_screen_space::{glam::DVec3, scenes::Scene};

/// A scene before it is moved to where f32 is precise.
pub struct World {
    /// All but its positions, which are empty.
    pub scene: Scene,
    /// Vertex positions in the world, one a normal.
    pub positions: Vec<DVec3>,
}

impl From<Scene> for World {
    fn from(mut scene: Scene) -> Self {
        let positions = std::mem::take(&mut scene.positions);
        Self {
            scene,
            positions: positions
                .into_iter()
                .map(|p| DVec3::from(p.map(f64::from)))
                .collect(),
        }
    }
}

impl World {
    /// The corners of its box; the low one is above the high one where it is empty.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        bounds(self.positions.iter().copied())
    }

    /// An eye that sees the whole from a corner above it, and what it looks at.
    pub fn corner_view(&self) -> [DVec3; 2] {
        let (low, high) = self.bounds();
        let center = (low + high) / 2.0;
        let size = (high - low).length();
        [center + size * DVec3::new(0.6, 0.4, 0.8), center]
    }

    /// The scene with positions relative to a point of the world.
    ///
    /// # Errors
    /// Where a position is too far from there for f32.
    pub fn relative_to(self, origin: DVec3) -> Result<Scene, String> {
        let mut scene = self.scene;
        scene.positions = self
            .positions
            .into_iter()
            .map(|p| (p - origin).as_vec3().to_array())
            .collect();
        if !scene.positions.as_flattened().iter().all(|x| x.is_finite()) {
            return Err(format!("the scene is too large, or too far from {origin}"));
        }
        Ok(scene)
    }
}

/// The corners of the box of points.
pub fn bounds(points: impl IntoIterator<Item = DVec3>) -> (DVec3, DVec3) {
    points
        .into_iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
            (low.min(p), high.max(p))
        })
}

/// The corners of a scene's box.
pub fn bounds_of(scene: &Scene) -> (DVec3, DVec3) {
    bounds(
        scene
            .positions
            .iter()
            .map(|p| DVec3::from(p.map(f64::from))),
    )
}

/// Where the positions of a scene in this box should be relative to, for an eye that looks at a target: close enough to what
/// is seen that f32 loses nothing that a pixel shows. It is the eye, or where the box is nearest to it, on a grid much
/// coarser than what is seen: a scene about the world's origin stays as it is, and coordinates of few digits keep them.
pub fn origin_for((low, high): (DVec3, DVec3), eye: DVec3, target: DVec3) -> DVec3 {
    let nearest = eye.max(low).min(high);
    let (size, distance) = (low.distance(high), eye.distance(target));
    let seen = if distance <= size {
        distance
    } else if nearest == eye {
        // The target is a direction, and says nothing of the scale of what is around the eye.
        0.0
    } else {
        size
    };
    let step = (16.0 * seen).log2().ceil().exp2();
    let snapped = (nearest / step).round() * step;
    if snapped.is_finite() {
        snapped
    } else {
        nearest
    }
}
