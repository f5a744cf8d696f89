// SurfelHoles: surfels of alpha-tested triangles, made to fit what is there of them.
//
//   fit_surfels   one thread per surfel
//
// A surfel stands for its leaf of a piece. It keeps the share of that area that is there, found at one point in each of 16 equal
// parts, and moves to the middle of what was found. Where surfels are not at the centroids of their leaves, they are whole or
// gone, by the point that they are at. Either way the area is right in expectation.

#import math
#import hashing
#import dispatch
#import surfel
#import triangle
#import cutout
#import cutout_at
#import map_alpha

alias Counter = u32;

struct Params {
  // 1 where surfels are at the centroids of their leaves.
  at_centroids: u32,
  padding0: u32,
  padding1: u32,
  padding2: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> counters: Counters;
@group(0) @binding(2) var<storage, read> pieces: array<Piece>;
@group(0) @binding(3) var<storage, read> cutouts: array<Cutout>;
@group(0) @binding(4) var<storage, read> sources: array<SurfelSource>;
@group(0) @binding(5) var<storage, read_write> surfels: array<vec4f>;
@group(0) @binding(6) var alpha_maps: texture_2d_array<f32>;

// Parts of a triangle: four rows from its first corner on, of 1, 3, 5 and 7.
const ROWS: f32 = 4.0;
const PARTS: u32 = 16u;

// Uniform over a part of a triangle.
fn point_in(t: Triangle, part: u32, key: u32) -> vec3f {
  let row = select(0u, 1u, part >= 1u) + select(0u, 1u, part >= 4u) + select(0u, 1u, part >= 9u);
  let along = part - row * row;
  let draw = hash2(key, part);
  let u = sqrt(unit_float(draw));
  let uv = u * unit_float(hash(draw ^ 0x5bd1e995u));
  // How far from the first corner, and from the edge to the second one, in rows. Every other part is upside down.
  let upright = (along & 1u) == 0u;
  let down = f32(row) + select(1.0 - u, u, upright);
  let aside = f32(along / 2u) + select(1.0 - uv, uv, upright);
  return t.a + (t.b - t.a) * ((down - aside) / ROWS) + (t.c - t.a) * (aside / ROWS);
}

fn is_there(point: vec3f, t: Triangle, cutout: Cutout) -> bool {
  return alpha_at(tex_coords_at(point, t, cutout), cutout.map) >= cutout.threshold;
}

@compute @workgroup_size(64)
fn fit_surfels(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= counters.stored {
    return;
  }
  let source = sources[i];
  let cutout = cutouts[source.piece];
  if cutout.threshold == 0.0 {
    return;
  }
  let piece = pieces[source.piece];
  let t = Triangle(piece.a, piece.b, piece.c);
  var surfel = surfels[i];
  let is_small = (piece.shape & SHAPE_SMALL) != 0u;
  if params.at_centroids != 0u || is_small {
    let leaf = leaf_of(t, source.leaf, select(piece.shape & SHAPE_ORDER, 0u, is_small));
    let key = hash2(hash2(piece.triangle, piece.shape >> SHAPE_PATH_SHIFT), source.leaf);
    var found = 0u;
    var middle = vec3f(0.0);
    for (var part = 0u; part < PARTS; part++) {
      let point = point_in(leaf, part, key);
      if is_there(point, t, cutout) {
        found++;
        middle += point - surfel.xyz;
      }
    }
    surfel = vec4f(surfel.xyz + middle / f32(max(found, 1u)), surfel.w * sqrt(f32(found) / f32(PARTS)));
  } else if !is_there(surfel.xyz, t, cutout) {
    surfel.w = 0.0;
  }
  surfels[i] = surfel;
}
