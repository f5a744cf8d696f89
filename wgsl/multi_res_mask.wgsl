// MultiResMask: which pixels of an image are computed at which resolution (Besenthal et al. 2019, 3.1). Near edges of the
// G-buffer at full resolution, farther from them ever more coarsely; what is listed on a level is listed on all coarser
// ones too.
//
// Edges and masks are textures of 8 bits per pixel with a texel for a block of 2 x 2 pixels: a fragment has a block, and
// what it reads for one of its pixels serves the others. A component whose pixel is beyond the image is 0.
//
//   find_edges  fragment: one value per pixel, 0 to 1
//   coarsen     fragment: of the next finer level's edges the maxima over 2 x 2 pixels
//   widen       fragment: of one level, the edges blurred, and the finer level's mask
//   count       of one level: listed pixels of each tile of 8 x 8, those whose image counts alone and those that are blended
//   list        of one level: after a prefix sum of the counts, the former and then the latter in the order of their tiles
//   stamp       fragment: of one level, 1 in a stencil buffer where a pixel is listed

#if EDGES

#import math
#import packing
#import camera
#import gbuffer
#import screen
#import block

struct Params {
  camera: Camera,
  normals: vec2u,
  depth_step: f32,
  depth_relative: f32,
  // What a step in depth is a share of, and linear over the image on a plane: the factors of ndc.x, ndc.y, 1 and
  // depth - far_depth. One over the distance for a perspective camera, the image's height for another.
  scale: vec4f,
  // What it grows by with depth, of another camera the view depth.
  slope: f32,
  // Least first difference of unit normals that is an edge.
  normal_threshold: f32,
  // Least second difference of depth, as a share of the distance.
  depth_threshold: f32,
  // Least first difference of the shading.
  shading_threshold: f32,
  // The bits EXTRA and IMPORTANCE.
  sources: u32,
  padding0: u32,
  padding1: u32,
  padding2: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var depth_texture: texture_2d<f32>;
@group(0) @binding(2) var normal_texture: texture_2d<f32>;
#if SHADING
@group(0) @binding(3) var shading: texture_2d<f32>;
#endif
#if GIVEN
// Of the caller; where it gave one of them alone, that stands for the other too and is not read there.
@group(0) @binding(4) var extra: texture_2d<f32>;
@group(0) @binding(5) var importance: texture_2d<f32>;
#endif

const EXTRA: u32 = 1u;
const IMPORTANCE: u32 = 2u;
// Differs from any shading.
const GARBAGE: f32 = 1e30;

// What of a pixel is differentiated.
struct Sample {
  normal: vec3f,
  depth: f32,
  shade: f32,
  // 1 for the sky, whose other values are 0.
  sky: f32,
}

fn texel_of(pixel: vec2i) -> vec2u {
  return params.camera.viewport.xy + vec2u(clamp(pixel, vec2i(0), vec2i(params.camera.viewport.zw) - 1));
}

// Beyond the image there is its border again, from which nothing differs.
fn sample_at(pixel: vec2i) -> Sample {
  let at = texel_of(pixel);
  let depth = textureLoad(depth_texture, at, 0).x;
  let foreground = select((depth < 1.0), (depth > 0.0), params.camera.far_depth == 0.0);
  let is_seen = foreground && is_finite(depth);
  // Axes do not matter to what two normals differ by.
  let normal = stored_normal(params.normals.x, textureLoad(normal_texture, at, 0).xyz, vec3f(0.0));
  var shade = 0.0;
#if SHADING
  let given = textureLoad(shading, at, 0).x;
  shade = select(GARBAGE, given, is_finite(given));
#endif
  return Sample(
    select(vec3f(0.0), normal, is_seen),
    select(0.0, depth, is_seen),
    select(0.0, shade, is_seen),
    select(1.0, 0.0, is_seen),
  );
}

// 0 up to the threshold, 1 from twice the threshold on. NaN is an edge.
fn beyond(value: f32, threshold: f32) -> f32 {
  let share = value / threshold - 1.0;
  return select(1.0, clamp(share, 0.0, 1.0), is_finite(value));
}

// First differences: of the normals squared, of the shading, and whether one is sky and the other is not.
fn contrast(a: Sample, b: Sample) -> vec3f {
  let d = a.normal - b.normal;
  return vec3f(dot(d, d), abs(a.shade - b.shade), abs(a.sky - b.sky));
}

// The second difference of what is linear over the image on a plane: its share that is linear in the pixel drops out, so
// that depth alone is left. `scale` is the pixel's, and changes by `step_in_scale` from pixel to pixel.
fn bend(before: Sample, centre: Sample, after: Sample, scale: f32, step_in_scale: f32) -> f32 {
  // What the depths' rounding alone can amount to is no edge: each may be off by a step.
  let depth = max(max(abs(before.depth), abs(after.depth)), abs(centre.depth));
  let step = params.depth_step + params.depth_relative * depth;
  let difference = abs((before.depth - centre.depth) + (after.depth - centre.depth));
  let far = params.camera.far_depth;
  let depths = params.scale.w * (vec3f(before.depth, centre.depth, after.depth) - far);
  let scales = scale + step_in_scale * vec3f(-1.0, 0.0, 1.0);
  let nearest = max(max_component(scales + depths), 1e-30);
  let value = max(difference - 4.0 * step, 0.0) * params.slope / nearest;
  return select(value, 0.0, before.sky + centre.sky + after.sky > 0.0);
}

// A value of the caller's; NaN is an edge.
fn sanitize(value: f32) -> f32 {
  return select(1.0, clamp(value, 0.0, 1.0), is_finite(value));
}

// Of a pixel, of which `before` are the left and the upper neighbour and `after` the others; 0 beyond the image.
fn edge(pixel: vec2i, centre: Sample, before: array<Sample, 2>, after: array<Sample, 2>) -> f32 {
  let size = vec2i(params.camera.viewport.zw);
  let rows = max(contrast(before[0], centre), contrast(centre, after[0]));
  let most = max(rows, max(contrast(before[1], centre), contrast(centre, after[1])));
  var value = max(most.z, beyond(sqrt(most.x), params.normal_threshold));
#if SHADING
  value = max(value, beyond(most.y, params.shading_threshold));
  value = select(value, 1.0, centre.shade == GARBAGE);
#endif
  let ndc = (vec2f(pixel) + 0.5) / vec2f(size) * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
  let scale = dot(params.scale.xyz, vec3f(ndc, 1.0));
  let steps = params.scale.xy * vec2f(2.0, -2.0) / vec2f(size);
  let bends = vec2f(bend(before[0], centre, after[0], scale, steps.x), bend(before[1], centre, after[1], scale, steps.y));
  let between = select(vec2f(0.0), bends, (pixel > vec2i(0)) & (pixel < (size - 1)));
  value = max(value, beyond(max(between.x, between.y), params.depth_threshold));
#if GIVEN
  let at = texel_of(pixel);
  if (params.sources & EXTRA) != 0u {
    value = max(value, sanitize(textureLoad(extra, at, 0).x));
  }
  if (params.sources & IMPORTANCE) != 0u {
    value = min(value, sanitize(textureLoad(importance, at, 0).x));
  }
#endif
  return select(0.0, value, all(pixel < size));
}

@fragment
fn find_edges(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  let p = 2 * vec2i(fragment.xy);
  let a = sample_at(p);
  let b = sample_at(p + vec2i(1, 0));
  let c = sample_at(p + vec2i(0, 1));
  let d = sample_at(p + vec2i(1, 1));
  let left_a = sample_at(p + vec2i(-1, 0));
  let left_c = sample_at(p + vec2i(-1, 1));
  let right_b = sample_at(p + vec2i(2, 0));
  let right_d = sample_at(p + vec2i(2, 1));
  let above_a = sample_at(p + vec2i(0, -1));
  let above_b = sample_at(p + vec2i(1, -1));
  let below_c = sample_at(p + vec2i(0, 2));
  let below_d = sample_at(p + vec2i(1, 2));
  return stored(vec4f(
    edge(p, a, array(left_a, above_a), array(b, c)),
    edge(p + vec2i(1, 0), b, array(a, above_b), array(right_b, d)),
    edge(p + vec2i(0, 1), c, array(left_c, a), array(d, below_c)),
    edge(p + vec2i(1, 1), d, array(c, b), array(right_d, below_d)),
  ));
}

#else
#if COARSEN

#import screen
#import block

@group(0) @binding(0) var edges: texture_2d<f32>;

fn largest(texel: vec2u) -> f32 {
  let end = textureDimensions(edges);
  let block = textureLoad(edges, min(texel, end - 1u), 0);
  return select(0.0, largest_of(block), all(texel < end));
}

@fragment
fn coarsen(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  let p = 2u * vec2u(fragment.xy);
  return vec4f(largest(p), largest(p + vec2u(1u, 0u)), largest(p + vec2u(0u, 1u)), largest(p + vec2u(1u)));
}

#else

struct Params {
  // Of the level, pixels.
  size: vec2u,
  tiles: vec2u,
  // The level's first count among those of all levels: one per tile of whole pixels, then one per tile of blended ones.
  first_count: u32,
  // By how many levels the finer one that is contained in this one is finer; 0 where there is none.
  finer_by: u32,
  // How many blocks the blur reaches to each side.
  reach: u32,
  // A blurred edge up to this is none.
  threshold: f32,
  // From which mask on a pixel's image counts alone.
  whole_from: f32,
  padding0: u32,
  padding1: u32,
  padding2: u32,
  // Of the blur, for a block i to the right: what a pixel counts for the same pixel of the other block, the right one
  // for the left one, and the left one for the right one.
  bell: array<vec4f, 5>,
}

@group(0) @binding(0) var<uniform> params: Params;

#if WIDEN

#import screen
#import block

@group(0) @binding(1) var edges: texture_2d<f32>;
#if FINER
@group(0) @binding(2) var finer: texture_2d<f32>;

// The largest value of the finer level's mask within a pixel.
fn within(pixel: vec2u) -> f32 {
  let side = 1u << (params.finer_by - 1u);
  let end = textureDimensions(finer);
  var value = 0.0;
  for (var i = 0u; i < side * side; i++) {
    let texel = pixel * side + vec2u(i % side, i / side);
    let there = largest_of(textureLoad(finer, min(texel, end - 1u), 0));
    value = max(value, select(0.0, there, all(texel < end)));
  }
  return value;
}
#endif

// What pixels at an offset of blocks count: for the same pixel, for the one before and for the one after it.
fn bell(offset: i32) -> vec3f {
  let w = params.bell[abs(offset)];
  return select(w.xzy, w.xyz, offset >= 0);
}

@fragment
fn widen(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  let middle = vec2i(fragment.xy);
  let end = vec2i(textureDimensions(edges));
  let reach = i32(params.reach);
  var value = vec4f(0.0);
  for (var y = -reach; y <= reach; y++) {
    var row = vec4f(0.0);
    for (var x = -reach; x <= reach; x++) {
      let there = middle + vec2i(x, y);
      let block = textureLoad(edges, clamp(there, vec2i(0), end - 1), 0);
      // Beyond the image there are no edges.
      let inside = select(0.0, 1.0, all((there >= vec2i(0)) & (there < end)));
      let w = inside * bell(x);
      row += block * w.x + block.yxwz * w.yzyz;
    }
    let w = bell(y);
    value += row * w.x + row.zwxy * w.yyzz;
  }
  value = min(value, vec4f(1.0));
  value = select(vec4f(0.0), value, value > vec4f(params.threshold));
  let p = 2u * vec2u(middle);
#if FINER
  let contained = vec4f(within(p), within(p + vec2u(1u, 0u)), within(p + vec2u(0u, 1u)), within(p + vec2u(1u)));
  value = max(value, contained);
#endif
  let columns = vec2u(p.x, p.x + 1u) < vec2u(params.size.x);
  let rows = vec2u(p.y, p.y + 1u) < vec2u(params.size.y);
  return select(vec4f(0.0), stored(value), columns.xyxy & rows.xxyy);
}

#else

@group(0) @binding(1) var mask: texture_2d<f32>;

#if LIST

#import dispatch

// First the counts, of all levels, then the sums before each, and their total.
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;
@group(0) @binding(3) var<storage, read_write> pixels: array<u32>;
@group(0) @binding(4) var<storage, read_write> workgroups: array<u32, 3>;
// Workgroups for the blended pixels, and how many come before them.
@group(0) @binding(5) var<storage, read_write> blended: array<u32, 4>;

// Blocks of a tile.
const BLOCKS: u32 = 16u;

fn corner_of_tile(tile: u32) -> vec2u {
  return 8u * vec2u(tile % params.tiles.x, tile / params.tiles.x);
}

fn corner_of_block(i: u32) -> vec2u {
  return 2u * vec2u(i % 4u, i / 4u);
}

// Which of a block's pixels are listed, whole or blended.
struct Listed {
  whole: vec4<bool>,
  blended: vec4<bool>,
}

fn listed(corner: vec2u) -> Listed {
  let block = textureLoad(mask, min(corner >> vec2u(1u), textureDimensions(mask) - 1u), 0);
  let columns = vec2u(corner.x, corner.x + 1u) < vec2u(params.size.x);
  let rows = vec2u(corner.y, corner.y + 1u) < vec2u(params.size.y);
  let inside = (block > vec4f(0.0)) & columns.xyxy & rows.xxyy;
  let is_whole = block >= vec4f(params.whole_from);
  return Listed(inside & is_whole, inside & !is_whole);
}

fn number(which: vec4<bool>) -> u32 {
  let ones = select(vec4u(0u), vec4u(1u), which);
  return ones.x + ones.y + ones.z + ones.w;
}

@compute @workgroup_size(64)
fn count(@builtin(global_invocation_id) id: vec3u) {
  let tile = id.x;
  let tiles = params.tiles.x * params.tiles.y;
  if tile >= tiles {
    return;
  }
  let corner = corner_of_tile(tile);
  var sums = vec2u(0u);
  for (var i = 0u; i < BLOCKS; i++) {
    let block = listed(corner + corner_of_block(i));
    sums += vec2u(number(block.whole), number(block.blended));
  }
  counts[params.first_count + tile] = sums.x;
  counts[params.first_count + tiles + tile] = sums.y;
}

fn groups_of(count: u32) -> vec3u {
  let groups = (count + 63u) / 64u;
  return vec3u(min(groups, DISPATCH_ROW), (groups + DISPATCH_ROW - 1u) / DISPATCH_ROW, 1u);
}

@compute @workgroup_size(64)
fn list(@builtin(global_invocation_id) id: vec3u) {
  let tile = id.x;
  let tiles = params.tiles.x * params.tiles.y;
  if tile >= tiles {
    return;
  }
  let first = counts[params.first_count];
  // Behind the number of all.
  var whole_at = 1u + counts[params.first_count + tile] - first;
  var blended_at = 1u + counts[params.first_count + tiles + tile] - first;
  let corner = corner_of_tile(tile);
  for (var i = 0u; i < BLOCKS; i++) {
    let start = corner + corner_of_block(i);
    let block = listed(start);
    for (var k = 0u; k < 4u; k++) {
      let pixel = (start.x + (k & 1u)) | ((start.y + (k >> 1u)) << 16u);
      if block.whole[k] || block.blended[k] {
        pixels[select(blended_at, whole_at, block.whole[k])] = pixel;
      }
      whole_at += select(0u, 1u, block.whole[k]);
      blended_at += select(0u, 1u, block.blended[k]);
    }
  }
  if tile == 0u {
    let before = counts[params.first_count + tiles] - first;
    let all = counts[params.first_count + 2u * tiles] - first;
    pixels[0] = all;
    let groups = groups_of(all);
    workgroups[0] = groups.x;
    workgroups[1] = groups.y;
    workgroups[2] = groups.z;
    let some = groups_of(all - before);
    blended[0] = some.x;
    blended[1] = some.y;
    blended[2] = some.z;
    blended[3] = before;
  }
}

#else

#import screen
#import block

@fragment
fn stamp(@builtin(position) fragment: vec4f) {
  let pixel = vec2u(fragment.xy);
  if of_block(textureLoad(mask, pixel >> vec2u(1u), 0), pixel) == 0.0 {
    discard;
  }
}

#endif
#endif
#endif
#endif
