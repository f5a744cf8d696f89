//! Mirror of `wgsl/surfelizer.wgsl`: lengths in f64, hashes and counts in the shader's own integers.
//!
//! The shader walks each triangle twice and more, to count its pieces and to write them; here they go to a list that
//! grows. What the shader leaves to f32 rounding may fall the other way here: the longest of two nearly equal edges,
//! whether to split, and how often to bisect.

use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

use glam::{DVec3, DVec4};

use super::{
    hashing::{hash, hash2, multiply_high, unit_float},
    packing::pack_normal,
};
use crate::{
    camera::{Camera, Footprint},
    surfel::Placement,
    surfel::{CloudCapacity, SurfelCounts},
    surfelizer::settings::{Reach, SurfelizerSettings},
};

const PIECE_EXTENT: f64 = 0.5;
const RAY_PIECE_EXTENT: f64 = 16.0;
const CULLED_ORDER: f64 = 16.0;
const MAX_ORDER: u32 = 24;
const MAX_GRID_LEVEL: u32 = 4000;
const MAX_DEPTH: u32 = 60;
const MAX_ROUNDS: u32 = 48_000;
const MAX_SEARCH_ROUNDS: u32 = 28_000;
const ANCHOR_STEP: u32 = 4;
const WHOLE: u32 = 31;
pub(super) const SHAPE_ORDER: u32 = 0xfff;
pub(super) const SHAPE_SMALL: u32 = 0x1000;
pub(super) const SHAPE_PATH_SHIFT: u32 = 13;
const SMALL_AREA: f64 = FRAC_1_SQRT_2;

/// Three corners in eye space.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Triangle {
    /// First corner.
    pub a: DVec3,
    /// Second corner.
    pub b: DVec3,
    /// Third corner.
    pub c: DVec3,
}

/// [`crate::Piece`] in f64.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Piece {
    /// Its corners, in the cloud's space.
    pub corners: Triangle,
    /// Index into the material table.
    pub material: u32,
    /// As [`crate::Piece::shape`].
    pub shape: u32,
    /// Index of its triangle.
    pub triangle: u32,
}

/// [`crate::Surfel`] and [`crate::SurfelSource`] in f64.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Surfel {
    /// Centre, in the cloud's space.
    pub position: DVec3,
    /// Radius, world units.
    pub radius: f64,
    /// Geometric normal, packed.
    pub normal: u32,
    /// Index of its piece.
    pub piece: u32,
    /// Its leaf in the piece's bisection tree.
    pub leaf: u32,
    /// Index into the material table.
    pub material: u32,
}

/// [`crate::SurfelCloud`] in f64.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    /// As many as found room.
    pub pieces: Vec<Piece>,
    /// As many as found room.
    pub surfels: Vec<Surfel>,
    /// The counters.
    pub counts: SurfelCounts,
}

pub(super) fn centroid(t: Triangle) -> DVec3 {
    (t.a + t.b + t.c) / 3.0
}

/// Twice the area along the normal, divided by `scale` squared.
pub(super) struct AreaVector {
    pub direction: DVec3,
    pub scale: f64,
}

pub(super) fn area_vector(t: Triangle) -> AreaVector {
    let e1 = t.b - t.a;
    let e2 = t.c - t.a;
    let scale = e1.abs().max_element().max(e2.abs().max_element());
    // The shader's range is that of f32.
    if scale.is_nan() || scale <= 0.0 || scale > f64::from(f32::MAX) {
        return AreaVector {
            direction: DVec3::ZERO,
            scale: 0.0,
        };
    }
    AreaVector {
        direction: (e1 / scale).cross(e2 / scale),
        scale,
    }
}

/// The square root of the area.
pub fn area_root(t: Triangle) -> f64 {
    let v = area_vector(t);
    v.scale * (0.5 * v.direction.length()).sqrt()
}

fn longest_edge(t: Triangle) -> u32 {
    let ab = t.b.distance_squared(t.a);
    let bc = t.c.distance_squared(t.b);
    let ca = t.a.distance_squared(t.c);
    let mut longest = 0;
    let mut best = ab;
    if bc > best * 1.001 {
        longest = 1;
        best = bc;
    }
    if ca > best * 1.001 {
        longest = 2;
    }
    longest
}

/// One half of a triangle cut at the middle of its longest edge.
pub fn bisect(t: Triangle, side: u32) -> Triangle {
    let [a, b, c] = match longest_edge(t) {
        0 => [t.a, t.b, t.c],
        1 => [t.b, t.c, t.a],
        _ => [t.c, t.a, t.b],
    };
    let middle = (a + b) * 0.5;
    if side == 0 {
        Triangle { a, b: middle, c }
    } else {
        Triangle { a: middle, b, c }
    }
}

/// How much of a triangle has surfels whose reach any view can see.
#[derive(Clone, Copy, PartialEq)]
enum Seen {
    WithinReach,
    Partly,
    OutOfReach,
}

/// How far a point is within a view's planes; negative outside.
fn in_view(planes: &[DVec4; 6], p: DVec3) -> f64 {
    planes
        .iter()
        .map(|plane| plane.dot(p.extend(1.0)))
        .fold(f64::INFINITY, f64::min)
}

/// What the walk does with a triangle.
#[derive(Clone, Copy, PartialEq)]
enum Verdict {
    Cull,
    Split,
    Take,
}

/// `Params` of the shader.
struct Params {
    footprint: Footprint,
    /// Relative to the cloud's origin.
    eye: DVec3,
    /// Six planes per view.
    views: Vec<[DVec4; 6]>,
    radius_pixels: f64,
    density: f64,
    reach: Reach,
    placement: Placement,
    capacity: CloudCapacity,
}

impl Params {
    fn target_radius(&self, p: DVec3) -> f64 {
        self.radius_pixels * self.footprint.at(p - self.eye)
    }

    fn relative_area(&self, t: Triangle) -> f64 {
        let x = area_root(t) / self.target_radius(centroid(t));
        x * x / PI
    }

    fn surfels_of(&self, shape: u32) -> u32 {
        let order = shape & SHAPE_ORDER;
        if shape & SHAPE_SMALL != 0 {
            return 1;
        }
        if self.placement != Placement::Grid {
            return 1 << order;
        }
        let half = order.div_ceil(2);
        if order & 1 == 0 {
            3 * half * (half + 1) + 1
        } else {
            3 * half * half
        }
    }

    fn seen_by_views(&self, t: Triangle) -> Seen {
        if self.views.is_empty() {
            return Seen::WithinReach;
        }
        let center = centroid(t);
        let extent = [t.a, t.b, t.c]
            .map(|corner| corner.distance(center))
            .into_iter()
            .fold(0.0, f64::max);
        let farthest = self.footprint.pixel
            * if self.footprint.perspective {
                (center.distance(self.eye) + extent).max(self.footprint.near)
            } else {
                1.0
            };
        let radius = 1.25 * self.radius_pixels * farthest * (1.0 / self.density.sqrt()).max(1.0);
        let reach = (f64::from(self.reach.radii) * radius).min(f64::from(self.reach.world));
        let inside = self
            .views
            .iter()
            .map(|planes| in_view(planes, center))
            .fold(f64::NEG_INFINITY, f64::max);
        if inside < -reach - extent {
            return Seen::OutOfReach;
        }
        if inside < extent - reach && extent > reach {
            Seen::Partly
        } else {
            Seen::WithinReach
        }
    }

    fn classify(&self, t: Triangle, coarseness: u32) -> Verdict {
        let seen = self.seen_by_views(t);
        if seen == Seen::OutOfReach {
            return Verdict::Cull;
        }
        if coarseness == WHOLE {
            return Verdict::Take;
        }
        if self.footprint.perspective {
            let center = centroid(t);
            let edge =
                t.a.distance(t.b)
                    .max(t.b.distance(t.c))
                    .max(t.c.distance(t.a));
            let mut extent = PIECE_EXTENT * center.distance(self.eye).max(self.footprint.near);
            if self.capacity.surfels == 0 {
                let normal = area_vector(t).direction.normalize_or_zero();
                let nearest = normal
                    .dot(center - self.eye)
                    .abs()
                    .max(center.distance(self.eye) - edge * 2.0 / 3.0);
                extent = RAY_PIECE_EXTENT * nearest.max(self.footprint.near);
            }
            if edge > extent * f64::from(1_u32 << coarseness) {
                return Verdict::Split;
            }
        }
        let large = self.relative_area(t).log2() > CULLED_ORDER + 2.0 * f64::from(coarseness);
        if seen == Seen::Partly && large && self.capacity.surfels != 0 {
            Verdict::Split
        } else {
            Verdict::Take
        }
    }

    fn piece_shape(&self, t: Triangle, triangle: u32, path: u32) -> Option<u32> {
        let a = self.relative_area(t);
        let tag = path << SHAPE_PATH_SHIFT;
        if a < SMALL_AREA {
            let salt = if path == 0 { 0 } else { hash(path) };
            let draw = unit_float(triangle.wrapping_mul(2_654_435_769).wrapping_add(salt));
            return (draw < self.density * a).then_some(tag | SHAPE_SMALL);
        }
        if self.placement == Placement::Grid {
            return Some(tag | grid_level(a));
        }
        Some(tag | bisections(a))
    }

    fn stand_in(&self, t: Triangle, shape: u32) -> Triangle {
        let a = self.relative_area(t);
        if shape & SHAPE_SMALL == 0 || self.density * a >= 1.0 {
            return t;
        }
        let center = centroid(t);
        let normal = area_vector(t).direction.normalize_or(DVec3::Z);
        let tangent = (t.b - t.a).normalize_or(DVec3::X);
        let area = PI * self.target_radius(center).powi(2) / self.density;
        let radius = (area * 4.0 / (3.0 * 3_f64.sqrt())).sqrt();
        let up = tangent * radius;
        let aside = normal.cross(tangent) * radius * 0.75_f64.sqrt();
        Triangle {
            a: center + up,
            b: center - 0.5 * up + aside,
            c: center - 0.5 * up - aside,
        }
    }

    fn walk(&self, root: Triangle, triangle: u32, quota: Option<u32>) -> Vec<(Triangle, u32)> {
        let mut path = Path::default();
        let mut node = root;
        let mut depth = 0;
        let mut anchor = root;
        let mut anchor_depth = 0;
        let mut coarseness = u32::from(quota.is_some());
        let mut cut = Vec::new();
        for round in 0.. {
            if depth < path.depth {
                if depth.is_multiple_of(ANCHOR_STEP) && path.depth - depth >= ANCHOR_STEP {
                    anchor = node;
                    anchor_depth = depth;
                }
                node = bisect(node, path.side(depth));
                depth += 1;
                continue;
            }
            let verdict = self.classify(node, coarseness);
            if verdict == Verdict::Split
                && path.depth < MAX_DEPTH
                && (round < MAX_ROUNDS || quota.is_some())
            {
                path = path.into_half(0);
                node = bisect(node, 0);
                depth += 1;
                continue;
            }
            if verdict != Verdict::Cull
                && let Some(shape) = self.piece_shape(node, triangle, path.hash())
            {
                cut.push((self.stand_in(node, shape), shape));
            }
            path = path.to_next();
            let late = round >= MAX_SEARCH_ROUNDS && coarseness != WHOLE;
            let over = |quota: u32| late || (path.depth == 0 && cut.len() > quota as usize);
            if quota.is_some_and(over) {
                coarseness = if late { WHOLE } else { coarseness + 1 };
                cut.clear();
                path = Path::default();
            } else if path.depth == 0 {
                break;
            }
            if anchor_depth >= path.depth {
                anchor = root;
                anchor_depth = 0;
            }
            node = anchor;
            depth = anchor_depth;
        }
        cut
    }

    /// A piece's shape bisected less.
    fn coarser(&self, shape: u32, by: u32) -> u32 {
        let order = shape & SHAPE_ORDER;
        let rest = shape & !SHAPE_ORDER;
        if self.placement == Placement::Grid {
            return rest | order.min((order >> by.div_ceil(2)).max(1));
        }
        rest | order.saturating_sub(by)
    }

    fn place(
        &self,
        t: Triangle,
        normal: DVec3,
        shape: u32,
        leaf: u32,
        key: u32,
        radius: f64,
    ) -> DVec3 {
        if shape & SHAPE_SMALL != 0 {
            return centroid(t);
        }
        let order = shape & SHAPE_ORDER;
        match self.placement {
            Placement::Centroid => centroid(leaf_of(t, leaf, order)),
            Placement::Random => random_point(t, key),
            Placement::Grid => {
                let center = centroid(t);
                let inner = Triangle {
                    a: inset(t.a, center, radius),
                    b: inset(t.b, center, radius),
                    c: inset(t.c, center, radius),
                };
                let tangent = (t.b - t.a).normalize_or(DVec3::X);
                let bitangent = normal.cross(tangent);
                let distance = radius * unit_float(hash(key)).sqrt();
                let angle = TAU * unit_float(hash(key ^ 0x5bd1_e995));
                grid_point(inner, leaf, order)
                    + distance * (angle.cos() * tangent + angle.sin() * bitangent)
            }
        }
    }
}

fn bisections(a: f64) -> u32 {
    (a.log2() + 0.5).floor().clamp(0.0, f64::from(MAX_ORDER)) as u32
}

fn grid_level(a: f64) -> u32 {
    ((12.0 * a - 3.0).max(0.0).sqrt() / 3.0 - 1.0)
        .ceil()
        .clamp(1.0, f64::from(MAX_GRID_LEVEL)) as u32
}

fn fetch(corners: [DVec3; 3], origin: DVec3) -> Triangle {
    let [a, b, c] = corners.map(|p| p - origin);
    if a.is_finite() && b.is_finite() && c.is_finite() {
        Triangle { a, b, c }
    } else {
        Triangle::default()
    }
}

/// The path from a triangle to a node of its bisection tree: bit d of it is the side taken at depth d.
#[derive(Clone, Copy, Default)]
struct Path {
    bits: u64,
    depth: u32,
}

impl Path {
    fn side(self, depth: u32) -> u32 {
        (self.bits >> depth) as u32 & 1
    }

    /// The path to one half of a node that has to be split.
    fn into_half(self, side: u32) -> Self {
        Self {
            bits: self.bits | (u64::from(side) << self.depth),
            depth: self.depth + 1,
        }
    }

    /// The path to the next node to the right, of depth 0 after the last one.
    fn to_next(self) -> Self {
        let open = !self.bits & ((1 << self.depth) - 1);
        if open == 0 {
            return Self::default();
        }
        let depth = open.ilog2();
        let above = Self {
            bits: self.bits & ((1 << depth) - 1),
            depth,
        };
        above.into_half(1)
    }

    fn hash(self) -> u32 {
        if self.depth == 0 {
            return 0;
        }
        hash2(
            self.bits as u32,
            hash2((self.bits >> 32) as u32, self.depth),
        ) >> SHAPE_PATH_SHIFT
    }
}

/// floor(capacity · 2³² / total) for capacity < total. The shader divides bit by bit.
fn keep_ratio(total: u32, capacity: u32) -> u32 {
    ((u64::from(capacity) << 32) / u64::from(total)) as u32
}

/// Room in an array of `capacity` for item `index` of `total`; `None` for those left out.
pub fn slot_for(index: u32, total: u32, capacity: u32) -> Option<u32> {
    if total <= capacity {
        return Some(index);
    }
    let ratio = keep_ratio(total, capacity);
    let room = multiply_high(index, ratio);
    let taken = index > 0 && multiply_high(index - 1, ratio) == room;
    (!taken).then_some(room)
}

/// The room of an item, or of the one before it that got one.
pub fn nearest_room(index: u32, total: u32, capacity: u32) -> u32 {
    if total <= capacity {
        return index;
    }
    multiply_high(index, keep_ratio(total, capacity))
}

/// How many slots are taken: the last one may not be.
pub fn slots_taken(total: u32, capacity: u32) -> u32 {
    if total == 0 || capacity == 0 {
        return 0;
    }
    nearest_room(total - 1, total, capacity) + 1
}

/// The inverse: the item that has a given room.
pub fn item_of(room: u32, total: u32, capacity: u32) -> u32 {
    if total <= capacity {
        return room;
    }
    let ratio = keep_ratio(total, capacity);
    let mut low = 0;
    let mut high = total - 1;
    while low < high {
        let middle = low + (high - low) / 2;
        if multiply_high(middle, ratio) >= room {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    low
}

/// A leaf of a piece's bisection tree of depth `order`.
pub fn leaf_of(piece: Triangle, leaf: u32, order: u32) -> Triangle {
    (0..order).fold(piece, |node, depth| {
        bisect(node, (leaf >> (order - 1 - depth)) & 1)
    })
}

/// The leaf that a point of the piece's plane lies in.
pub fn leaf_at(piece: Triangle, point: DVec3, order: u32) -> u32 {
    let normal = (piece.b - piece.a).cross(piece.c - piece.a);
    let mut node = piece;
    let mut leaf = 0;
    for _ in 0..order {
        let first = bisect(node, 0);
        let across = (first.c - first.b).cross(point - first.b).dot(normal);
        let side = u32::from(across < 0.0);
        leaf = leaf * 2 + side;
        node = if side == 0 { first } else { bisect(node, 1) };
    }
    leaf
}

fn random_point(t: Triangle, key: u32) -> DVec3 {
    let u = unit_float(hash(key)).sqrt();
    let v = unit_float(hash(key ^ 0x5bd1_e995));
    t.a * (1.0 - u) + t.b * (u * (1.0 - v)) + t.c * (u * v)
}

/// Vertex k of the pattern of Deep Screen Space 3.1: concentric triangles with `level`, `level` − 2, … segments a side.
pub fn grid_point(t: Triangle, k: u32, level: u32) -> DVec3 {
    let center = centroid(t);
    let mut ring = level;
    let mut at = k;
    while ring > 0 && at >= 3 * ring {
        at -= 3 * ring;
        ring = ring.saturating_sub(2);
    }
    if ring == 0 {
        return center;
    }
    let along = f64::from(at % ring) / f64::from(ring);
    let p = match at / ring {
        0 => t.a.lerp(t.b, along),
        1 => t.b.lerp(t.c, along),
        _ => t.c.lerp(t.a, along),
    };
    center.lerp(p, f64::from(ring) / f64::from(level))
}

fn inset(corner: DVec3, center: DVec3, r: f64) -> DVec3 {
    let d = center - corner;
    corner + d * (r / d.length().max(1e-30)).min(1.0)
}

/// The cloud that the [`Surfelizer`](crate::Surfelizer) makes of world-space triangles, given their materials one by
/// one. The triangles wind as they are to be seen: a mirroring transform has been undone.
pub fn surfelize(
    settings: &SurfelizerSettings,
    camera: &Camera,
    cull_by: &[Camera],
    capacity: CloudCapacity,
    triangles: &[[DVec3; 3]],
    materials: &[u32],
) -> Cloud {
    let origin = camera.focus();
    let params = Params {
        eye: camera.eye() - origin,
        footprint: camera.footprint(),
        views: cull_by.iter().map(|view| view.frustum(origin)).collect(),
        radius_pixels: f64::from(settings.radius_pixels),
        density: f64::from(settings.density),
        reach: settings.reach,
        placement: settings.placement,
        capacity,
    };

    // count_pieces
    let mut counts = SurfelCounts::default();
    let mut cuts = Vec::new();
    for (triangle, (&corners, &material)) in triangles.iter().zip(materials).enumerate() {
        let root = fetch(corners, origin);
        if area_root(root) > 0.0 {
            let triangle = triangle as u32;
            cuts.push(TriangleCut {
                root,
                triangle,
                material,
                pieces: params.walk(root, triangle, None),
            });
        } else {
            counts.rejected += 1;
        }
    }
    let largest = cuts.iter().fold(0.0, |l, c| area_root(c.root).max(l));

    // merge_pieces
    let asked = total(&cuts);
    if asked > u64::from(capacity.pieces) {
        let cut_triangles = cuts.iter().filter(|c| !c.pieces.is_empty()).count() as u32;
        for cut in &mut cuts {
            let pieces = cut.pieces.len() as u32;
            if pieces > 0 {
                let quota = quota_of(pieces, cut_triangles, asked, capacity.pieces);
                cut.pieces = params.walk(cut.root, cut.triangle, Some(quota));
            }
        }
    }
    counts.pieces = u32::try_from(total(&cuts)).unwrap_or(u32::MAX);
    counts.merged = u32::try_from(asked)
        .unwrap_or(u32::MAX)
        .saturating_sub(counts.pieces);

    // emit_pieces; a room that none takes stays empty, without surfels.
    let by = coarser_by(&params, &cuts);
    let mut pieces = vec![Piece::default(); counts.pieces.min(capacity.pieces) as usize];
    let mut surfels_of = vec![0; pieces.len()];
    let mut index = 0;
    let (mut area, mut lost) = (0.0, 0.0);
    for cut in &cuts {
        for &(corners, shape) in &cut.pieces {
            let shape = params.coarser(shape, by);
            let share = (area_root(corners) / largest).powi(2);
            area += share;
            if let Some(room) = slot_for(index, counts.pieces, capacity.pieces) {
                pieces[room as usize] = Piece {
                    corners,
                    material: cut.material,
                    shape,
                    triangle: cut.triangle,
                };
                surfels_of[room as usize] = params.surfels_of(shape);
            } else {
                lost += share;
            }
            index += 1;
        }
    }
    if lost > 0.0 {
        counts.lost_area = ((lost / area * 4_294_967_296.0) as u32).max(1);
    }

    // (prefix sum), finish
    let piece_offsets: Vec<u32> = surfels_of
        .iter()
        .map(|&surfels| {
            let offset = counts.surfels;
            counts.surfels = offset.saturating_add(surfels);
            offset
        })
        .collect();
    counts.stored = counts.surfels.min(capacity.surfels);

    let surfels = (0..counts.stored)
        .map(|i| emit_surfel(&params, capacity, &counts, &pieces, &piece_offsets, i))
        .collect();
    Cloud {
        pieces,
        surfels,
        counts,
    }
}

/// What a triangle is cut into: pieces and their shapes.
struct TriangleCut {
    root: Triangle,
    triangle: u32,
    material: u32,
    pieces: Vec<(Triangle, u32)>,
}

fn total(cuts: &[TriangleCut]) -> u64 {
    cuts.iter().map(|c| c.pieces.len() as u64).sum()
}

/// How many of its pieces a triangle that asks for `asked` of `pieces` may keep where they are merged: one, and its share
/// of the room that one of each triangle leaves.
fn quota_of(asked: u32, triangles: u32, pieces: u64, capacity: u32) -> u32 {
    let spare = capacity.max(triangles) - triangles;
    let more = pieces - u64::from(triangles);
    let shift = u64::BITS.saturating_sub(u32::BITS + more.leading_zeros());
    let more = (more >> shift) as u32 + u32::from(shift > 0);
    if spare >> shift >= more {
        return asked;
    }
    1 + multiply_high(asked - 1, keep_ratio(more, spare >> shift))
}

/// How often each piece is bisected less than asked for, so that the number of all surfels stays below 2^32.
fn coarser_by(params: &Params, cuts: &[TriangleCut]) -> u32 {
    let surfels: u64 = cuts
        .iter()
        .flat_map(|c| &c.pieces)
        .map(|&(_, shape)| u64::from(params.surfels_of(shape)))
        .sum();
    33_u32.saturating_sub(surfels.leading_zeros())
}

fn emit_surfel(
    params: &Params,
    capacity: CloudCapacity,
    counts: &SurfelCounts,
    pieces: &[Piece],
    piece_offsets: &[u32],
    i: u32,
) -> Surfel {
    let item = item_of(i, counts.surfels, capacity.surfels);
    let low = piece_offsets.partition_point(|&offset| offset <= item) - 1;
    let piece = pieces[low];
    let leaf = item - piece_offsets[low];
    let t = piece.corners;
    let normal = area_vector(t).direction.normalize_or(DVec3::Z);

    let mut radius = area_root(t) / (PI * f64::from(params.surfels_of(piece.shape))).sqrt();
    radius *= (f64::from(counts.surfels) / f64::from(capacity.surfels))
        .max(1.0)
        .sqrt()
        * (f64::from(counts.pieces) / f64::from(capacity.pieces))
            .max(1.0)
            .sqrt();

    let key = hash2(hash2(piece.triangle, piece.shape >> SHAPE_PATH_SHIFT), leaf);
    Surfel {
        position: params.place(t, normal, piece.shape, leaf, key, radius),
        radius,
        normal: pack_normal(normal),
        piece: low as u32,
        leaf,
        material: piece.material,
    }
}
