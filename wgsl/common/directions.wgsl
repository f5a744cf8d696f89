// Directions of a pixel: one in each cell of a grid over the unit square, which maps to the hemisphere by equal shares
// of the integrand's cosine (or of solid angle).
//
// Within their cells pixels take points that depend linearly on where the pixel is, modulo 1: a lattice in the four
// dimensions of pixels and square. It was chosen so that waves over the square, unless they are short, become fast ones over
// the pixels: then the points of any neighbourhood, whatever its shape, lie evenly, and a filter with a soft edge sees all of
// the cell from a few pixels. Over frames all points of a cell move together by those of a (0,2)-sequence: each pixel's
// directions of 2^k frames in a row from a multiple of 2^k are stratified 2^k times as finely as those of one frame. Rays of
// one cell and of neighbouring pixels stay near each other.

#import math
#import hashing

const SAMPLE_COSINE: u32 = 0u;
const SAMPLE_UNIFORM: u32 = 1u;

// Of Sobol's (0,2)-sequence the first coordinate is the index's bits reversed, the first one being worth 1/2, and the second
// one this with its bits reversed. Bit j is the sum of the bits k whose binomial coefficient (k, j) is odd, those that have
// all of j's bits: one step for each bit of j.
fn sobol2(index: u32) -> u32 {
  var v = index;
  v ^= (v >> 1u) & 0x55555555u;
  v ^= (v >> 2u) & 0x33333333u;
  v ^= (v >> 4u) & 0x0f0f0f0fu;
  v ^= (v >> 8u) & 0x00ff00ffu;
  return v ^ (v >> 16u);
}

// Owen's scrambling of a number in reversed bits: whether a bit flips depends on the key and the bits below it alone (Laine
// and Karras 2011; the constants are N. Vegdahl's). What is stratified by leading digits stays so.
fn scramble(bits: u32, key: u32) -> u32 {
  var v = bits ^ (bits * 0x3d20adeau);
  v += key;
  v *= (key >> 16u) | 1u;
  v ^= v * 0x05526c56u;
  return v ^ (v * 0x53a22864u);
}

// What a step to the next column and to the next row adds to x and to y, in units of 2^-32. Found by search: the least error
// of Gaussian windows of many sizes and shapes, down to strips one pixel wide, over spectra of edges in all directions and along
// the axes. With powers of the plastic number (M. Roberts, The Unreasonable Effectiveness of Quasirandom Sequences, 2018) in
// their place strips see as much, and by that measure wide windows have two to three times the error.
const LATTICE_X: vec2u = vec2u(1784664572u, 1394608229u);
const LATTICE_Y: vec2u = vec2u(1036808364u, 2481981723u);

// By what the points of a further set are off those of the set before: powers of the plastic number (M. Roberts 2018), so that
// the sets of a pixel lie evenly within each cell, however many they are.
const TURN_STEP: vec2u = vec2u(3242174889u, 2447445414u);

// The fractional part of the golden ratio, in the same units.
const GOLDEN_STEP: u32 = 2654435769u;

// Where in its cell, in those units, the point lies of a key's further set of rays. Sums of integers wrap as the square does.
fn point_within(pixel: vec2u, index: u32, turn: u32, frame: u32) -> vec2u {
  // Each cell has frames of its own order, and so a place of its own in the first.
  let key = hash(index + 1u);
  let over_frames = vec2u(scramble(frame, key), scramble(sobol2(frame), hash(key)));
  let over_pixels = vec2u(
    LATTICE_X.x * pixel.x + LATTICE_X.y * pixel.y,
    LATTICE_Y.x * pixel.x + LATTICE_Y.y * pixel.y,
  );
  return over_pixels + reverseBits(over_frames) + turn * TURN_STEP;
}

// The point of cell `index` of columns x rows, in the unit square, of a further set of rays.
fn further_point(pixel: vec2u, index: u32, turn: u32, columns: u32, rows: u32, frame: u32) -> vec2f {
  let within = point_within(pixel, index, turn, frame);
  let x = unit_float(within.x);
  let y = unit_float(within.y);
  return vec2f((f32(index % columns) + x) / f32(columns), (f32(index / columns) + y) / f32(rows));
}

// That of a pixel's first set.
fn cell_point(pixel: vec2u, index: u32, columns: u32, rows: u32, frame: u32) -> vec2f {
  return further_point(pixel, index, 0u, columns, rows, frame);
}

// A point of the unit square for one of `count` rays that no grid suits, as most of them go to few places: each has a share of
// its own of y, in the same place of it, and x by the golden ratio. So of each part of y there are as many as there can be of
// `count`, or one more.
fn strewn_point(pixel: vec2u, index: u32, count: u32, turn: u32, frame: u32) -> vec2f {
  let within = point_within(pixel, 0u, turn, frame);
  let x = unit_float(within.x + index * GOLDEN_STEP);
  return vec2f(x, (f32(index) + unit_float(within.y)) / f32(count));
}

// The unit square to the unit disk by equal areas, squares about the centre to circles (Shirley and Chiu 1997): the point, and
// the square of its distance from the centre. Of the point's own length little is sure beyond what a driver's sines are: near
// the rim their error would be all there is of 1 - r2.
fn concentric_disk(square: vec2f) -> vec3f {
  let p = 2.0 * square - 1.0;
  if all(p == vec2f(0.0)) {
    return vec3f(0.0);
  }
  let wide = abs(p.x) > abs(p.y);
  let radius = select(p.y, p.x, wide);
  let angle = select(PI / 2.0 - (PI / 4.0) * (p.x / p.y), (PI / 4.0) * (p.y / p.x), wide);
  return vec3f(radius * vec2f(cos(angle), sin(angle)), radius * radius);
}

struct Direction {
  direction: vec3f,
  // Density over solid angle with which it was drawn.
  pdf: f32,
}

// About a unit normal.
fn hemisphere_direction(point: vec2f, normal: vec3f, sampling: u32) -> Direction {
  let disk = concentric_disk(point);
  let r2 = disk.z;
  if sampling == SAMPLE_UNIFORM {
    // Equal areas of the disk to equal areas of the hemisphere: the height falls linearly.
    let height = 1.0 - r2;
    let d = vec3f(disk.xy * sqrt(max(2.0 - r2, 0.0)), height);
    return Direction(tangent_frame(normal) * d, 0.5 / PI);
  }
  let height = sqrt(max(1.0 - r2, 0.0));
  return Direction(tangent_frame(normal) * vec3f(disk.xy, height), height / PI);
}
