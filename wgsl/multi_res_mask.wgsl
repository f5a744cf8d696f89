// MultiResMask: which pixels of an image are computed at which resolution (Besenthal et al. 2019, 3.1). Near edges of the
// G-buffer at full resolution, farther from them ever more coarsely; what is listed on a level is listed on all coarser
// ones too.
//
//   find_edges  one value a pixel, 0 to 1, and its maxima over 2 x 2, 4 x 4 and 8 x 8 pixels
//   widen       of one level: the edges blurred, and the finer level's mask; pixels listed are counted by tiles of 8 x 8
//   list        of one level: after a prefix sum of the counts, the listed pixels in the order of their tiles
//   stamp       fragment: of one level, 1 in a stencil buffer where a pixel is listed

#if EDGES

#import surface

struct Params {
  camera: Camera,
  normals: vec2u,
  depth_step: f32,
  depth_relative: f32,
  // Least first difference of unit normals that is an edge.
  normal_threshold: f32,
  // Least second difference of depth, as a share of the distance.
  depth_threshold: f32,
  // Least first difference of the shading.
  shading_threshold: f32,
  // The bits SHADING, EXTRA and IMPORTANCE.
  sources: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var depth_texture: texture_2d<f32>;
@group(0) @binding(2) var normal_texture: texture_2d<f32>;
// Of the caller; where it gave none another texture stands here and is not read.
@group(0) @binding(3) var shading: texture_2d<f32>;
@group(0) @binding(4) var extra: texture_2d<f32>;
@group(0) @binding(5) var importance: texture_2d<f32>;
@group(0) @binding(6) var edges_0: texture_storage_2d<r32float, write>;
@group(0) @binding(7) var edges_1: texture_storage_2d<r32float, write>;
@group(0) @binding(8) var edges_2: texture_storage_2d<r32float, write>;
@group(0) @binding(9) var edges_3: texture_storage_2d<r32float, write>;

const SHADING: u32 = 1u;
const EXTRA: u32 = 2u;
const IMPORTANCE: u32 = 4u;

// What of a pixel is differentiated.
struct Sample {
  normal: vec3f,
  depth: f32,
  // Linear over the image on a plane: one over the view depth for a perspective camera, view depth for another.
  linear: f32,
  shade: f32,
  sky: bool,
}

fn sample_at(pixel: vec2u) -> Sample {
  let at = params.camera.viewport.xy + pixel;
  let depth = textureLoad(depth_texture, at, 0).x;
  let is_seen = unproject(params.camera, pixel, depth).w != 0.0;
  // A point's homogeneous coordinates end in it, and on a pixel's ray it alone changes with the depth.
  let middle = vec2f(pixel) + 0.5;
  let ndc = middle / vec2f(params.camera.viewport.zw) * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
  let h = params.camera.unproject * vec4f(ndc, depth - params.camera.far_depth, 1.0);
  let along = depth * length(params.camera.unproject[2].xyz);
  var shade = 0.0;
  if (params.sources & SHADING) != 0u {
    shade = textureLoad(shading, at, 0).x;
  }
  return Sample(
    decode_normal(params.camera, params.normals, textureLoad(normal_texture, at, 0).xyz, vec3f(0.0)),
    depth,
    select(along, h.w, params.camera.perspective != 0u),
    shade,
    !is_seen,
  );
}

// 0 up to the threshold, 1 from twice the threshold on. NaN is an edge.
fn beyond(value: f32, threshold: f32) -> f32 {
  let share = value / threshold - 1.0;
  return select(clamp(share, 0.0, 1.0), 1.0, !is_finite(value));
}

fn first_difference(a: Sample, b: Sample) -> f32 {
  if a.sky || b.sky {
    return select(1.0, 0.0, a.sky && b.sky);
  }
  let normal = beyond(distance(a.normal, b.normal), params.normal_threshold);
  return max(normal, beyond(abs(a.shade - b.shade), params.shading_threshold));
}

fn second_difference(before: Sample, centre: Sample, after: Sample) -> f32 {
  if before.sky || centre.sky || after.sky {
    return 0.0;
  }
  // What the depths' rounding alone can amount to is no edge: each may be off by a step.
  let depth = max(max(abs(before.depth), abs(after.depth)), abs(centre.depth));
  let step = params.depth_step + params.depth_relative * depth;
  let is_perspective = params.camera.perspective != 0u;
  let slope = select(length(params.camera.unproject[2].xyz), abs(params.camera.unproject[2].w), is_perspective);
  let nearest = max(max(before.linear, after.linear), centre.linear);
  let extent = params.camera.pixel * f32(params.camera.viewport.w);
  let difference = abs((before.linear - centre.linear) + (after.linear - centre.linear));
  let rounding = 4.0 * step * slope;
  return beyond(max(difference - rounding, 0.0) / select(extent, nearest, is_perspective), params.depth_threshold);
}

// A value of the caller's; NaN is an edge.
fn sound(value: f32) -> f32 {
  return select(clamp(value, 0.0, 1.0), 1.0, !is_finite(value));
}

fn edge(pixel: vec2u) -> f32 {
  let last = params.camera.viewport.zw - 1u;
  let centre = sample_at(pixel);
  var value = 0.0;
  for (var axis = 0u; axis < 2u; axis++) {
    let along = select(vec2u(0u, 1u), vec2u(1u, 0u), axis == 0u);
    let has_before = pixel[axis] > 0u;
    let has_after = pixel[axis] < last[axis];
    // Beyond the image there is nothing to differ from.
    let before = sample_at(select(pixel, pixel - along, has_before));
    let after = sample_at(select(pixel, pixel + along, has_after));
    value = max(value, max(first_difference(before, centre), first_difference(centre, after)));
    if has_before && has_after {
      value = max(value, second_difference(before, centre, after));
    }
  }
  let at = params.camera.viewport.xy + pixel;
  if (params.sources & EXTRA) != 0u {
    value = max(value, sound(textureLoad(extra, at, 0).x));
  }
  if (params.sources & IMPORTANCE) != 0u {
    value = min(value, sound(textureLoad(importance, at, 0).x));
  }
  return value;
}

var<workgroup> tile: array<f32, 64>;

// The maximum over a square of four squares of `half` pixels, for the threads at its corner.
fn maximum(index: u32, half: u32) -> f32 {
  return max(max(tile[index], tile[index + half]), max(tile[index + 8u * half], tile[index + 9u * half]));
}

@compute @workgroup_size(8, 8)
fn find_edges(
  @builtin(global_invocation_id) id: vec3u,
  @builtin(local_invocation_id) local: vec3u,
  @builtin(local_invocation_index) index: u32,
) {
  let inside = all(id.xy < params.camera.viewport.zw);
  var value = 0.0;
  if inside {
    value = edge(id.xy);
    textureStore(edges_0, id.xy, vec4f(value, 0.0, 0.0, 0.0));
  }
  tile[index] = value;
  workgroupBarrier();
  if all((local.xy & vec2u(1u)) == vec2u(0u)) {
    value = maximum(index, 1u);
    if inside {
      textureStore(edges_1, id.xy >> vec2u(1u), vec4f(value, 0.0, 0.0, 0.0));
    }
    tile[index] = value;
  }
  workgroupBarrier();
  if all((local.xy & vec2u(3u)) == vec2u(0u)) {
    value = maximum(index, 2u);
    if inside {
      textureStore(edges_2, id.xy >> vec2u(2u), vec4f(value, 0.0, 0.0, 0.0));
    }
    tile[index] = value;
  }
  workgroupBarrier();
  if index == 0u {
    textureStore(edges_3, id.xy >> vec2u(3u), vec4f(maximum(0u, 4u), 0.0, 0.0, 0.0));
  }
}

#else

struct Params {
  // Of the level, pixels.
  size: vec2u,
  tiles: vec2u,
  // Of the finer level that is contained in this one.
  finer_size: vec2u,
  // By how many levels it is finer; 0 where there is none.
  finer_by: u32,
  // Half width of the blur.
  radius: u32,
  // 1 / (2 variance).
  falloff: f32,
  // A blurred edge up to this is none.
  threshold: f32,
  // 1 where all pixels are listed.
  everything: u32,
  // The level's first tile among those of all levels.
  first_tile: u32,
}

@group(0) @binding(0) var<uniform> params: Params;

#if WIDEN

@group(0) @binding(1) var edges: texture_2d<f32>;
@group(0) @binding(2) var finer: texture_2d<f32>;
@group(0) @binding(3) var mask: texture_storage_2d<r32float, write>;
@group(0) @binding(4) var<storage, read_write> counts: array<u32>;

// The widest half width that there is room for.
const MAX_RADIUS: u32 = 8u;
const SIDE: u32 = 8u + 2u * MAX_RADIUS;

var<workgroup> window: array<f32, SIDE * SIDE>;
var<workgroup> rows: array<f32, SIDE * 8u>;
var<workgroup> listed: atomic<u32>;

// Not normalised.
fn bell(offset: u32) -> f32 {
  return exp(-f32(offset * offset) * params.falloff);
}

@compute @workgroup_size(8, 8)
fn widen(
  @builtin(workgroup_id) group: vec3u,
  @builtin(global_invocation_id) id: vec3u,
  @builtin(local_invocation_id) local: vec3u,
  @builtin(local_invocation_index) index: u32,
) {
  let radius = min(params.radius, MAX_RADIUS);
  let side = 8u + 2u * radius;
  let last = vec2i(params.size) - 1;
  if index == 0u {
    atomicStore(&listed, 0u);
  }
  // Beyond the image it goes on with its border.
  for (var i = index; i < side * side; i += 64u) {
    let at = vec2i(group.xy * 8u + vec2u(i % side, i / side)) - i32(radius);
    window[i] = textureLoad(edges, clamp(at, vec2i(0), last), 0).x;
  }
  workgroupBarrier();
  var total = bell(0u);
  for (var offset = 1u; offset <= radius; offset++) {
    total += 2.0 * bell(offset);
  }
  for (var i = index; i < side * 8u; i += 64u) {
    let at = (i / 8u) * side + i % 8u + radius;
    var sum = window[at] * bell(0u);
    for (var offset = 1u; offset <= radius; offset++) {
      sum += (window[at - offset] + window[at + offset]) * bell(offset);
    }
    rows[i] = sum / total;
  }
  workgroupBarrier();
  if all(id.xy < params.size) {
    let at = (local.y + radius) * 8u + local.x;
    var value = rows[at] * bell(0u);
    for (var offset = 1u; offset <= radius; offset++) {
      value += (rows[at - 8u * offset] + rows[at + 8u * offset]) * bell(offset);
    }
    value /= total;
    value = select(0.0, min(value, 1.0), value > params.threshold);
    if params.finer_by != 0u {
      let block = 1u << params.finer_by;
      for (var i = 0u; i < block * block; i++) {
        let there = min(id.xy * block + vec2u(i % block, i / block), params.finer_size - 1u);
        value = max(value, textureLoad(finer, there, 0).x);
      }
    }
    value = select(value, 1.0, params.everything != 0u);
    textureStore(mask, id.xy, vec4f(value, 0.0, 0.0, 0.0));
    if value > 0.0 {
      atomicAdd(&listed, 1u);
    }
  }
  workgroupBarrier();
  if index == 0u {
    counts[params.first_tile + group.y * params.tiles.x + group.x] = atomicLoad(&listed);
  }
}

#else

@group(0) @binding(1) var mask: texture_2d<f32>;

#if LIST

#import dispatch

// The sums of the counts before each tile, of all levels, and their total.
@group(0) @binding(2) var<storage, read> before: array<u32>;
@group(0) @binding(3) var<storage, read_write> pixels: array<u32>;
@group(0) @binding(4) var<storage, read_write> workgroups: array<u32, 3>;

var<workgroup> bits: array<atomic<u32>, 2>;

@compute @workgroup_size(8, 8)
fn list(
  @builtin(workgroup_id) group: vec3u,
  @builtin(global_invocation_id) id: vec3u,
  @builtin(local_invocation_index) index: u32,
) {
  if index < 2u {
    atomicStore(&bits[index], 0u);
  }
  workgroupBarrier();
  let is_listed = all(id.xy < params.size) && textureLoad(mask, min(id.xy, params.size - 1u), 0).x > 0.0;
  let bit = 1u << (index & 31u);
  if is_listed {
    atomicOr(&bits[index >> 5u], bit);
  }
  workgroupBarrier();
  let first = before[params.first_tile];
  let tile = params.first_tile + group.y * params.tiles.x + group.x;
  if is_listed {
    var rank = countOneBits(atomicLoad(&bits[index >> 5u]) & (bit - 1u));
    rank += select(0u, countOneBits(atomicLoad(&bits[0])), index >= 32u);
    pixels[1u + before[tile] - first + rank] = id.x | (id.y << 16u);
  }
  if all(group.xy == vec2u(0u)) && index == 0u {
    let count = before[params.first_tile + params.tiles.x * params.tiles.y] - first;
    let groups = (count + 63u) / 64u;
    pixels[0] = count;
    workgroups[0] = min(groups, DISPATCH_ROW);
    workgroups[1] = (groups + DISPATCH_ROW - 1u) / DISPATCH_ROW;
    workgroups[2] = 1u;
  }
}

#else

#import screen

@fragment
fn stamp(@builtin(position) fragment: vec4f) {
  if textureLoad(mask, min(vec2u(fragment.xy), params.size - 1u), 0).x == 0.0 {
    discard;
  }
}

#endif
#endif
#endif
