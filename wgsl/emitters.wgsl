// Emitters: the table by which rays are drawn towards a cloud's pieces that shine of themselves.
//
//   measure   one thread per piece: the logarithm of its power, the most of all, and how many shine
//   weigh     one thread per piece: its weight, as a share of the most
//
// Weights are integers, so that their sums (wgsl/scan.wgsl) are exact and every piece has the density that its rays are drawn
// with. What is too weak to have a weight by itself has one by chance, or none: rays that meet it by chance make up for that.

#import math
#import hashing
#import dispatch
#import surfel
#import material
#import slots
#import triangle

alias Counter = u32;

struct Params {
  // Pieces that the cloud has room for.
  capacity: u32,
  padding0: u32,
  padding1: u32,
  padding2: u32,
}

struct Range {
  // Bits of the largest level.
  most: atomic<u32>,
  // Pieces that shine.
  count: atomic<u32>,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> counters: Counters;
@group(0) @binding(2) var<storage, read> pieces: array<Piece>;
@group(0) @binding(3) var<storage, read> materials: array<Material>;
// Bits of the level of each piece, 0 for none; then its weight. Behind the pieces 0.
@group(0) @binding(4) var<storage, read_write> weights: array<u32>;
@group(0) @binding(5) var<storage, read_write> range: Range;

// Levels are above 0, and in the order of their bits.
const LEVEL_OFFSET: f32 = 1024.0;
// What all weights add up to at most; with one more each, of up to 2^23 pieces, they do not reach 2^32.
const WHOLE: u32 = 0xf0000000u;
// Beyond these a fraction is lost in rounding anyway.
const FINE: f32 = 65536.0;

fn luminance(color: vec3f) -> f32 {
  return dot(color, vec3f(0.2126, 0.7152, 0.0722));
}

// The logarithm of emission times area: as a product it would leave the range of f32. 0 for pieces that do not shine.
fn level_of(piece: Piece) -> f32 {
  let material = materials[min(piece.material, arrayLength(&materials) - 1u)];
  let brightness = luminance(sanitize(material.emission));
  let area = area_vector(Triangle(piece.a, piece.b, piece.c));
  let twice = length(area.direction);
  if !(brightness > 0.0) || !(twice > 0.0) || !is_finite(twice) {
    return 0.0;
  }
  return max(LEVEL_OFFSET + log2(brightness) + log2(twice) + 2.0 * log2(area.scale), 1.0);
}

@compute @workgroup_size(64)
fn measure(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= arrayLength(&weights) {
    return;
  }
  var level = 0.0;
  if i < slots_taken(counters.pieces, params.capacity) {
    level = level_of(pieces[i]);
  }
  weights[i] = bitcast<u32>(level);
  if level > 0.0 {
    atomicMax(&range.most, bitcast<u32>(level));
    atomicAdd(&range.count, 1u);
  }
}

@compute @workgroup_size(64)
fn weigh(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= arrayLength(&weights) || weights[i] == 0u {
    return;
  }
  let off = bitcast<f32>(weights[i]) - bitcast<f32>(atomicLoad(&range.most));
  var weight = exp2(off) * f32(WHOLE / atomicLoad(&range.count));
  if weight < FINE {
    // Rounded up as often as its fraction says.
    weight += unit_float(hash(i));
  }
  weights[i] = u32(weight);
}
