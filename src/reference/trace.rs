//! Rays against triangles: the ground truth that everything else is held against.
//!
//! A [`Tracer`] finds its candidates in a bounding volume hierarchy of `f32` boxes (crate `obvhs`)
//! and tests them in `f64`. The boxes are grown by more than their own rounding, so which triangle
//! a ray meets is decided by the `f64` test alone: the answer is that of a loop over all
//! triangles.

mod ambient_occlusion;
mod hemisphere;
mod one_bounce;
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

pub use ambient_occlusion::Estimate;
pub use hemisphere::Receiver;
pub use one_bounce::ColorEstimate;
use triangle::{Line, Triangle};

/// How far every box of the tree is grown, in the tree's own units (see [`Frame`]). A ray inside
/// the tree has coordinates up to 1 and a length up to 2·√3. Rounding its origin and direction to
/// `f32` and the few operations of a slab test displace it by less than 8 · 2⁻²⁴ of that length,
/// 1.7e-6.
const BOX_MARGIN: f32 = 4e-6;

/// [`Tracer::epsilon`] relative to the scene's size.
const RELATIVE_EPSILON: f64 = 1e-6;

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
    tree: Bvh2,
    /// In the order of the tree's leaves.
    triangles: Vec<Triangle>,
    frame: Frame,
    skipped: usize,
    epsilon: f64,
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
        let skipped = faces.len() - triangles.len();
        let frame = Frame::around(&triangles);
        let tree = build_tree(&triangles, &frame);
        let triangles = tree
            .primitive_indices
            .iter()
            .map(|index| triangles[*index as usize])
            .collect();
        Ok(Self {
            tree,
            triangles,
            epsilon: RELATIVE_EPSILON * frame.magnitude(),
            frame,
            skipped,
        })
    }

    /// How many triangles were left out.
    pub fn skipped(&self) -> usize {
        self.skipped
    }

    /// How far a ray starts off the surface it leaves, so that it does not meet that surface
    /// again: 1e-6 of the diagonal of the scene's bounding box, or of the largest coordinate if
    /// that is larger. The second case is that of a scene far from the origin, where a receiver
    /// stored in `f32` is off its surface by up to 6e-8 of its coordinates.
    pub fn epsilon(&self) -> f64 {
        self.epsilon
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
        let span = self.frame.enter(origin, direction, t_min, t_max)?;
        let line = Line::new(origin, direction);
        let mut nearest: Option<(Hit, &Triangle)> = None;
        self.tree
            .ray_traverse(span.ray, &mut RayHit::none(), |_, slot| {
                let triangle = &self.triangles[slot];
                match triangle.meet(&line) {
                    Some(hit)
                        if (t_min..t_max).contains(&hit.t)
                            && nearest.is_none_or(|(old, _)| is_before(&hit, &old)) =>
                    {
                        nearest = Some((hit, triangle));
                        span.tree_distance(hit.t)
                    }
                    _ => f32::INFINITY,
                }
            });
        nearest
    }

    /// Whether a ray meets any triangle at a distance in `t_min..t_max`; the rest is as for
    /// [`first_hit`](Self::first_hit).
    pub fn occluded(&self, origin: DVec3, direction: DVec3, t_min: f64, t_max: f64) -> bool {
        let Some(direction) = direction.try_normalize() else {
            return false;
        };
        let Some(span) = self.frame.enter(origin, direction, t_min, t_max) else {
            return false;
        };
        let line = Line::new(origin, direction);
        let missed = self.tree.ray_traverse_miss(span.ray, |_, slot| {
            match self.triangles[slot].meet(&line) {
                // Any distance below the ray's end stops the traversal.
                Some(hit) if (t_min..t_max).contains(&hit.t) => 0.0,
                _ => f32::INFINITY,
            }
        });
        !missed
    }
}

/// Nearer, or as near with a lower index.
fn is_before(hit: &Hit, other: &Hit) -> bool {
    (hit.t, hit.triangle) < (other.t, other.triangle)
}

/// The place of the scene in the unit cube around the origin, where its tree lives. A relative
/// `f32` error is then an absolute one too, whatever the scene's size and place.
struct Frame {
    /// The scene's bounding box; the low corner is above the high one where there is no triangle.
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
