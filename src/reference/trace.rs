//! Rays against triangles: the ground truth that everything else is held against.
//!
//! A [`Tracer`] finds its candidates in bounding volume hierarchies of `f32` boxes (crate `obvhs`)
//! and tests them in `f64`. The boxes are grown by more than their own rounding, so which triangle
//! a ray meets is decided by the `f64` test alone: the answer is that of a loop over all
//! triangles. Small triangles on a much larger ground have a tree of their own, whose boxes are
//! grown by what is little against them.
//!
//! A ray leaves a surface by the rounding of `f64` alone, so that a scene far from the origin, or on
//! a large ground, keeps its detail. For that its start is first put onto the surface: a receiver
//! that was stored in `f32` lies off it by more.

mod ambient_occlusion;
mod bent_normal;
mod bounces;
mod environment;
mod glossy;
mod hemisphere;
mod one_bounce;
mod subsurface_scattering;
mod triangle;

use glam::DVec3;
use obvhs::Boundable;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::ray::{Ray, RayHit};
use thiserror::Error;

use super::alpha_test::{AlphaMaps, Cutout, Holes, of_scene};
use super::light::Arrival;
use crate::Light;
use crate::scenes::Scene;

pub use ambient_occlusion::Estimate;
pub use bent_normal::BentEstimate;
pub use glossy::Gloss;
pub use hemisphere::Receiver;
pub use one_bounce::ColorEstimate;
pub use subsurface_scattering::LitPoint;
use triangle::{Line, Triangle};

/// How far every box of the tree is grown, in the tree's own units (see [`Frame`]). A ray inside
/// the tree has coordinates up to 1 and a length up to 2·√3. Rounding its origin and direction to
/// `f32` and the few operations of a slab test displace it by less than 8 · 2⁻²⁴ of that length,
/// 1.7e-6.
const BOX_MARGIN: f32 = 4e-6;

/// [`Tracer::epsilon`] relative to the scene's size: thousands of roundings of `f64`.
const RELATIVE_EPSILON: f64 = 1e-12;

/// How far a receiver may lie off its surface, relative to the scene's size.
const RECEIVER_TOLERANCE: f64 = 1e-6;

/// The cosine between a receiver's normal and that of the surface it lies on, at least.
const SAME_SURFACE: f64 = 0.9;

/// A light lies on a triangle where its plane is as near as a rounding of its place to `f32`.
const LIGHT_ROUNDING: f64 = 6e-8;

/// Triangles get a tree of their own where they and all together are smaller than the rest by this.
const SMALLER: f64 = 1.0 / 64.0;
const MOST_TREES: usize = 8;

/// The tree counts its nodes, nearly two to a triangle, in 32 bits.
const MAX_TRIANGLES: usize = 1 << 30;

/// What [`Tracer::new`] cannot make a tracer of.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum TraceError {
    /// The indices do not come in threes.
    #[error("{indices} indices are not a whole number of triangles")]
    PartialTriangle {
        /// How many indices there are.
        indices: usize,
    },
    /// There are more triangles than the tree can count.
    #[error("{triangles} triangles are more than the {MAX_TRIANGLES} that a tracer holds")]
    TooManyTriangles {
        /// How many triangles there are.
        triangles: usize,
    },
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the ray's origin.
    pub t: f64,
    /// Which triangle, counted in the index list [`Tracer::new`] was given, skipped ones included.
    pub triangle: usize,
    /// Weights of the triangle's second and third corner; the first has what is left to 1.
    pub barycentric: [f64; 2],
}

/// A set of triangles that rays can be shot at.
pub struct Tracer {
    /// Of triangles of different sizes.
    trees: Vec<Tree>,
    skipped: usize,
    /// The holes of triangles, if any have some.
    holes: Option<(Vec<Option<Cutout>>, AlphaMaps)>,
    /// The larger of the bounding box's diagonal and its largest coordinate.
    magnitude: f64,
}

/// Some of the triangles.
struct Tree {
    nodes: Bvh2,
    /// In the order of the tree's leaves.
    triangles: Vec<Triangle>,
    frame: Frame,
}

impl Tracer {
    /// Takes a triangle mesh and builds its tree.
    ///
    /// A triangle without area, with a coordinate that is not finite or with an index out of range
    /// is left out and counted in [`skipped`](Self::skipped). A mesh may be empty.
    ///
    /// # Errors
    /// When `indices` do not come in threes, or are too many.
    pub fn new(positions: &[[f32; 3]], indices: &[u32]) -> Result<Self, TraceError> {
        let (faces, rest) = indices.as_chunks::<3>();
        if !rest.is_empty() {
            return Err(TraceError::PartialTriangle {
                indices: indices.len(),
            });
        }
        if faces.len() > MAX_TRIANGLES {
            return Err(TraceError::TooManyTriangles {
                triangles: faces.len(),
            });
        }

        let triangles: Vec<Triangle> = faces
            .iter()
            .enumerate()
            .filter_map(|(index, face)| Triangle::new(positions, *face, index as u32))
            .collect();
        Ok(Self {
            skipped: faces.len() - triangles.len(),
            holes: None,
            magnitude: Frame::around(&triangles).magnitude(),
            trees: trees_of(triangles),
        })
    }

    /// Takes a scene's triangles, with the holes that they have.
    ///
    /// # Errors
    /// As [`Tracer::new`].
    pub fn of_scene(scene: &Scene) -> Result<Self, TraceError> {
        let tracer = Self::new(&scene.positions, &scene.indices)?;
        Ok(match of_scene(scene) {
            Some((cutouts, maps)) => tracer.with_holes(cutouts, maps),
            None => tracer,
        })
    }

    /// The same with holes in triangles: those of each, counted in the index list, if it has any. Rays pass them.
    #[must_use]
    pub fn with_holes(self, cutouts: Vec<Option<Cutout>>, maps: AlphaMaps) -> Self {
        Self {
            holes: Some((cutouts, maps)),
            ..self
        }
    }

    /// Whether a triangle is there, where it would be met.
    fn is_there(&self, hit: &Hit) -> bool {
        self.holes.as_ref().is_none_or(|(cutouts, maps)| {
            Holes { cutouts, maps }.is_there(hit.triangle, hit.barycentric)
        })
    }

    /// How many triangles were left out.
    pub fn skipped(&self) -> usize {
        self.skipped
    }

    /// How far a ray starts off the surface it leaves, so that it does not meet that surface
    /// again: 1e-12 of the diagonal of the scene's bounding box, or of the largest coordinate if
    /// that is larger.
    pub fn epsilon(&self) -> f64 {
        RELATIVE_EPSILON * self.magnitude
    }

    /// Where rays start that leave a receiver: off the surface it lies on, on the side of its normal,
    /// which has unit length. The surface is the nearest one of about that normal, within 1e-6 of the
    /// scene's size along it; without one the receiver lies in the air.
    pub fn start(&self, receiver: DVec3, normal: DVec3) -> DVec3 {
        let reach = RECEIVER_TOLERANCE * self.magnitude;
        let line = Line::new(receiver, normal);
        let mut nearest = f64::INFINITY;
        for tree in &self.trees {
            let Some(span) = tree.frame.enter(receiver, normal, -reach, reach) else {
                continue;
            };
            tree.nodes
                .ray_traverse(span.ray, &mut RayHit::none(), |_, slot| {
                    let triangle = &tree.triangles[slot];
                    if let Some(hit) = triangle.meet(&line)
                        && hit.t.abs() <= reach
                        && hit.t.abs() < nearest.abs()
                        && triangle.normal().dot(normal).abs() >= SAME_SURFACE
                    {
                        nearest = hit.t;
                    }
                    f32::INFINITY
                });
        }
        let along = if nearest.is_finite() { nearest } else { 0.0 };
        receiver + normal * (along + self.epsilon())
    }

    /// The nearest triangle, seen from either side, that a ray meets at a distance in
    /// `t_min..t_max`. Of two at the same distance, as on a shared edge, the one with the lower
    /// index counts.
    ///
    /// A ray in a triangle's plane passes it by; so does a ray whose origin or direction is not
    /// finite, or whose direction is zero. `direction` should have unit length and is made so.
    pub fn first_hit(
        &self,
        origin: DVec3,
        direction: DVec3,
        t_min: f64,
        t_max: f64,
    ) -> Option<Hit> {
        self.nearest(origin, direction, t_min, t_max)
            .map(|(hit, _)| hit)
    }

    /// The same, with the triangle.
    fn nearest(
        &self,
        origin: DVec3,
        direction: DVec3,
        t_min: f64,
        t_max: f64,
    ) -> Option<(Hit, &Triangle)> {
        let direction = direction.try_normalize()?;
        let line = Line::new(origin, direction);
        let mut nearest: Option<(Hit, &Triangle)> = None;
        for tree in &self.trees {
            let end = nearest.map_or(t_max, |(hit, _)| hit.t);
            let Some(span) = tree.frame.enter(origin, direction, t_min, end) else {
                continue;
            };
            tree.nodes
                .ray_traverse(span.ray, &mut RayHit::none(), |_, slot| {
                    let triangle = &tree.triangles[slot];
                    match triangle.meet(&line) {
                        Some(hit)
                            if (t_min..t_max).contains(&hit.t)
                                && nearest.is_none_or(|(old, _)| is_before(&hit, &old))
                                && self.is_there(&hit) =>
                        {
                            nearest = Some((hit, triangle));
                            span.tree_distance(hit.t)
                        }
                        _ => f32::INFINITY,
                    }
                });
        }
        nearest
    }

    /// Whether a ray meets any triangle at a distance in `t_min..t_max`; the rest is as for
    /// [`first_hit`](Self::first_hit).
    pub fn occluded(&self, origin: DVec3, direction: DVec3, t_min: f64, t_max: f64) -> bool {
        self.meets_any(origin, direction, t_min, t_max, |_| true)
    }

    /// Whether any triangle lies between a point and a light. What the light itself lies on does not.
    fn hidden(&self, origin: DVec3, way: &Arrival, light: &Light) -> bool {
        match *light {
            Light::Directional { .. } => self.occluded(origin, way.to_light, 0.0, f64::INFINITY),
            Light::Point { position, .. } | Light::Spot { position, .. } => {
                let near = LIGHT_ROUNDING * position.abs().max_element() + self.epsilon();
                self.meets_any(origin, way.to_light, 0.0, way.distance, |triangle| {
                    triangle.plane_distance(position) > near
                })
            }
        }
    }

    fn meets_any(
        &self,
        origin: DVec3,
        direction: DVec3,
        t_min: f64,
        t_max: f64,
        counts: impl Fn(&Triangle) -> bool,
    ) -> bool {
        let Some(direction) = direction.try_normalize() else {
            return false;
        };
        let line = Line::new(origin, direction);
        self.trees.iter().any(|tree| {
            let Some(span) = tree.frame.enter(origin, direction, t_min, t_max) else {
                return false;
            };
            let missed = tree.nodes.ray_traverse_miss(span.ray, |_, slot| {
                let triangle = &tree.triangles[slot];
                match triangle.meet(&line) {
                    // Any distance below the ray's end stops the traversal.
                    Some(hit)
                        if (t_min..t_max).contains(&hit.t)
                            && counts(triangle)
                            && self.is_there(&hit) =>
                    {
                        0.0
                    }
                    _ => f32::INFINITY,
                }
            });
            !missed
        })
    }
}

/// Nearer, or as near with a lower index.
fn is_before(hit: &Hit, other: &Hit) -> bool {
    (hit.t, hit.triangle) < (other.t, other.triangle)
}

/// The place of a tree's triangles in the unit cube around the origin, where the tree lives. A relative
/// `f32` error is then an absolute one too, whatever the scene's size and place.
struct Frame {
    /// The bounding box; the low corner is above the high one where there is no triangle.
    low: DVec3,
    high: DVec3,
    centre: DVec3,
    /// Half the longest side of the bounding box.
    scale: f64,
}

impl Frame {
    fn around(triangles: &[Triangle]) -> Self {
        let (low, high) = triangles.iter().flat_map(Triangle::corners).fold(
            (DVec3::INFINITY, DVec3::NEG_INFINITY),
            |(low, high), corner| (low.min(corner), high.max(corner)),
        );
        Self {
            low,
            high,
            centre: (low + high) / 2.0,
            scale: (high - low).max_element() / 2.0,
        }
    }

    fn is_empty(&self) -> bool {
        self.low.cmpgt(self.high).any()
    }

    /// The larger of the bounding box's diagonal and its largest coordinate; zero when empty.
    fn magnitude(&self) -> f64 {
        if self.is_empty() {
            return 0.0;
        }
        let coordinate = self.low.abs().max(self.high.abs()).max_element();
        coordinate.max((self.high - self.low).length())
    }

    fn to_tree(&self, point: DVec3) -> [f32; 3] {
        ((point - self.centre) / self.scale).as_vec3().to_array()
    }

    /// The part of a ray between two distances that may lie inside the tree.
    fn enter(&self, origin: DVec3, direction: DVec3, t_min: f64, t_max: f64) -> Option<Span> {
        if self.is_empty() || !origin.is_finite() {
            return None;
        }
        let margin = DVec3::splat(f64::from(BOX_MARGIN) * self.scale);
        let (low, high) = (self.low - margin, self.high + margin);
        let (mut start, mut end) = (t_min, t_max);
        for axis in 0..3 {
            let (from, along) = (origin[axis], direction[axis]);
            if along == 0.0 {
                // The division below would give 0/0 on a face of the box.
                if from < low[axis] || from > high[axis] {
                    return None;
                }
                continue;
            }
            let (one, other) = ((low[axis] - from) / along, (high[axis] - from) / along);
            start = start.max(one.min(other));
            end = end.min(one.max(other));
        }
        if start > end {
            return None;
        }
        // Far origins lose digits here, but not the claim to lie inside the box.
        let entry = (origin + direction * start).clamp(low, high);
        let mut span = Span {
            ray: Ray::new(
                self.to_tree(entry).into(),
                direction.as_vec3().to_array().into(),
                0.0,
                0.0,
            ),
            start,
            scale: self.scale,
        };
        span.ray.tmax = span.tree_distance(end);
        Some(span)
    }
}

/// A ray in the units of the tree, from where it enters the tree's box.
struct Span {
    ray: Ray,
    /// Distance from the true origin to that place, in the scene's units.
    start: f64,
    scale: f64,
}

impl Span {
    /// A distance along the true ray in the tree's units, a little too long so that rounding
    /// cannot cut a box at that distance off.
    fn tree_distance(&self, t: f64) -> f32 {
        ((t - self.start) / self.scale) as f32 + BOX_MARGIN
    }
}

/// The grown box of a triangle.
struct Leaf(Aabb);

impl Boundable for Leaf {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

/// Trees of triangles of about one size each, the largest first.
fn trees_of(mut triangles: Vec<Triangle>) -> Vec<Tree> {
    let mut trees = Vec::new();
    while !triangles.is_empty() {
        let frame = Frame::around(&triangles);
        let (small, large): (Vec<_>, Vec<_>) = triangles
            .iter()
            .partition(|triangle| triangle.extent() <= SMALLER * frame.scale);
        let apart = Frame::around(&small).scale <= SMALLER * frame.scale;
        let (own, rest) = if apart && trees.len() + 1 < MOST_TREES {
            (large, small)
        } else {
            (triangles, Vec::new())
        };
        // Its triangles may lie all in one place far away.
        let frame = Frame::around(&own);
        let nodes = build_tree(&own, &frame);
        let in_order = nodes.primitive_indices.iter();
        trees.push(Tree {
            triangles: in_order.map(|index| own[*index as usize]).collect(),
            nodes,
            frame,
        });
        triangles = rest;
    }
    trees
}

/// The steps of `obvhs::bvh2::builder::build_bvh2` with its medium settings, without the check of
/// the whole tree that it makes in debug builds, which takes longer than the build.
fn build_tree(triangles: &[Triangle], frame: &Frame) -> Bvh2 {
    const MAX_TRIANGLES_PER_LEAF: u32 = 8;
    const TRAVERSAL_COST: f32 = 3.0;
    /// Share of the nodes that each of two passes tries to find a better parent for.
    const REINSERTED: f32 = 0.05;

    let leaves: Vec<Leaf> = triangles
        .iter()
        .map(|triangle| Leaf(leaf_box(triangle, frame)))
        .collect();
    let mut tree = PlocBuilder::with_capacity(leaves.len()).build(
        PlocSearchDistance::Medium,
        &leaves,
        (0..leaves.len() as u32).collect(),
        SortPrecision::U64,
        3,
    );
    let mut optimizer = ReinsertionOptimizer::default();
    optimizer.run(&mut tree, REINSERTED, None);
    collapse(&mut tree, MAX_TRIANGLES_PER_LEAF, TRAVERSAL_COST);
    optimizer.run(&mut tree, 2.0 * REINSERTED, None);
    if !tree.nodes.is_empty() {
        // Traversal sizes its stack by this, and reinsertion may have deepened the tree.
        tree.max_depth = tree.max_depth.max(tree.depth(0) + 1);
    }
    tree
}

fn leaf_box(triangle: &Triangle, frame: &Frame) -> Aabb {
    let corners = triangle.corners().map(|corner| frame.to_tree(corner));
    let mut bounds = Aabb::empty();
    for corner in corners {
        bounds.extend(corner.map(|x| x - BOX_MARGIN).into());
        bounds.extend(corner.map(|x| x + BOX_MARGIN).into());
    }
    bounds
}
