// MultiResReconstructor: one image of the sub-images that an effect computed for a MultiResMask (Besenthal et al. 2019,
// 3.3 and 4.2).
//
// Of level i the mask a_i, times the weight w_i, says how much its image counts over what the coarser levels give:
//   c'_i = c_i min(a_i w_i, 1) + c'_(i+1) (1 - min(a_i w_i, 1))
// from the coarsest level to the finest. It is summed here from the finest on, which is the same and ends where nothing
// of what is coarser is left to be seen.
//
// Between the pixels of a sub-image values are bilinear, of those that were computed and that lie on the pixel's own
// surface.
//
// @group(0) @binding(0) params, 1 depth, 2 normals, 3 ... 6 masks, 7 ... 10 images

#import surface
#import sub_image
#import screen

struct Params {
  camera: Camera,
  normals: vec2u,
  depth_step: f32,
  depth_relative: f32,
  weights: vec4f,
  // A bit for each level that there is.
  levels: u32,
  coarsest: u32,
  // How far off a pixel's tangent plane a neighbour may lie, in pixels of the sub-image.
  plane_distance: f32,
  // Exponent of the cosine between normals, 8 or more.
  normal_power: f32,
  // A bit for each level whose pixels about one are on its surface where the next finer level has nothing listed there.
  alike: u32,
  padding0: u32,
  padding1: u32,
  padding2: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var depth_texture: texture_2d<f32>;
@group(0) @binding(2) var normal_texture: texture_2d<f32>;
// Of levels that there are not another level's stand here and are not read.
@group(0) @binding(3) var mask_0: texture_2d<f32>;
@group(0) @binding(4) var mask_1: texture_2d<f32>;
@group(0) @binding(5) var mask_2: texture_2d<f32>;
@group(0) @binding(6) var mask_3: texture_2d<f32>;
@group(0) @binding(7) var image_0: texture_2d<f32>;
@group(0) @binding(8) var image_1: texture_2d<f32>;
@group(0) @binding(9) var image_2: texture_2d<f32>;
@group(0) @binding(10) var image_3: texture_2d<f32>;

// What a neighbour on another surface counts: all there is where no other is.
const STRANGER: f32 = 1e-4;
// The share of its neighbours' weight that a level must have computed, and on the pixel's surface, to count fully.
const CONFIDENT: f32 = 0.125;

fn mask_at(texel: vec2u, level: u32) -> f32 {
  switch level {
    case 0u: { return textureLoad(mask_0, texel, 0).x; }
    case 1u: { return textureLoad(mask_1, texel, 0).x; }
    case 2u: { return textureLoad(mask_2, texel, 0).x; }
    default: { return textureLoad(mask_3, texel, 0).x; }
  }
}

fn image_at(texel: vec2u, level: u32) -> vec3f {
  var texel_value = vec4f(0.0);
  switch level {
    case 0u: { texel_value = textureLoad(image_0, texel, 0); }
    case 1u: { texel_value = textureLoad(image_1, texel, 0); }
    case 2u: { texel_value = textureLoad(image_2, texel, 0); }
    default: { texel_value = textureLoad(image_3, texel, 0); }
  }
#if COLOR
  return texel_value.xyz;
#else
  return texel_value.xxx;
#endif
}

// The four pixels of a sub-image about a pixel of the image.
struct Corners {
  first: vec2u,
  last: vec2u,
  // Of the last ones.
  share: vec2f,
}

fn corners_about(pixel: vec2u, level: u32) -> Corners {
  let size = params.camera.viewport.zw;
  let end = (size - 1u) >> vec2u(level);
  let half = (1u << level) >> 1u;
  let first = min(select(vec2u(0u), (pixel - half) >> vec2u(level), pixel >= vec2u(half)), end);
  let last = min(first + 1u, end);
  // The last pixel of a sub-image may stand for one nearer than the others do.
  let from_first = vec2f(pixel) - vec2f(stands_for(first, level, size));
  let extent = vec2f(stands_for(last, level, size)) - vec2f(stands_for(first, level, size));
  return Corners(first, last, clamp(from_first / max(extent, vec2f(1.0)), vec2f(0.0), vec2f(1.0)));
}

fn corner(corners: Corners, i: u32) -> vec2u {
  return select(corners.first, corners.last, vec2<bool>((i & 1u) != 0u, (i & 2u) != 0u));
}

fn corner_weight(corners: Corners, i: u32) -> f32 {
  let share = select(1.0 - corners.share, corners.share, vec2<bool>((i & 1u) != 0u, (i & 2u) != 0u));
  return share.x * share.y;
}

// 1 for a pixel itself; 0 across an edge in depth or between perpendicular surfaces. Of a reach in world units.
fn similarity(p: Surface, q: Surface, reach: f32) -> f32 {
  if p.sky || q.sky {
    return select(0.0, 1.0, p.sky && q.sky);
  }
  let d = q.position - p.position;
  let off_plane = max(abs(dot(p.normal, d)), abs(dot(q.normal, d))) / max(reach, 1e-30);
  let in_plane = max(1.0 - off_plane * off_plane, 0.0);
  let base = max(1.0 - (params.normal_power / 8.0) * (1.0 - dot(p.normal, q.normal)), 0.0);
  let base2 = base * base;
  let base4 = base2 * base2;
  return in_plane * in_plane * base4 * base4;
}

// A level's value at a pixel, how much of it there is, and the mask.
struct Layer {
  value: vec3f,
  alpha: f32,
  mask: f32,
}

// `finer` is the mask of the next finer level, 1 where there is none.
fn layer_of(pixel: vec2u, finer: f32, level: u32) -> Layer {
  let is_last = level == params.coarsest;
  if level == 0u {
    let mask = mask_at(pixel, 0u);
    if mask == 0.0 {
      return Layer(vec3f(0.0), 0.0, 0.0);
    }
    let value = image_at(pixel, 0u);
    if !is_finite3(value) {
      return Layer(vec3f(0.0), 0.0, mask);
    }
    return Layer(value, select(min(mask * params.weights.x, 1.0), 1.0, is_last), mask);
  }
  let corners = corners_about(pixel, level);
  var masks: vec4f;
  var mask = 0.0;
  for (var i = 0u; i < 4u; i++) {
    masks[i] = mask_at(corner(corners, i), level);
    mask += masks[i] * corner_weight(corners, i);
  }
  let alpha = select(min(mask * params.weights[level], 1.0), 1.0, is_last);
  if alpha == 0.0 {
    return Layer(vec3f(0.0), 0.0, mask);
  }
  let is_alike = finer == 0.0 && (params.alike & (1u << level)) != 0u;
  var p: Surface;
  if !is_alike {
    p = surface_at(pixel);
  }
  let reach = params.plane_distance * f32(1u << level) * footprint(params.camera, p.position - params.camera.eye);
  var value = vec3f(0.0);
  var total = 0.0;
  var own = 0.0;
  for (var i = 0u; i < 4u; i++) {
    let texel = corner(corners, i);
    let there = image_at(texel, level);
    let weight = corner_weight(corners, i);
    if masks[i] > 0.0 && weight > 0.0 && is_finite3(there) {
      var alike = 1.0;
      if !is_alike {
        let q = surface_at(stands_for(texel, level, params.camera.viewport.zw));
        alike = similarity(p, q, reach);
      }
      value += weight * (alike + STRANGER) * there;
      total += weight * (alike + STRANGER);
      own += weight * alike;
    }
  }
  value /= max(total, 1e-30);
  return Layer(value, select(alpha * min(own / CONFIDENT, 1.0), 1.0, is_last), mask);
}

@fragment
fn blend(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  let size = vec2i(params.camera.viewport.zw);
  let pixel = vec2u(clamp(vec2i(fragment.xy) - vec2i(params.camera.viewport.xy), vec2i(0), size - 1));
  var value = vec3f(0.0);
  var remaining = 1.0;
  var finer = 1.0;
  for (var level = 0u; level <= params.coarsest && remaining > 0.0; level++) {
    if (params.levels & (1u << level)) == 0u {
      continue;
    }
    let layer = layer_of(pixel, finer, level);
    finer = layer.mask;
    if layer.alpha > 0.0 {
      value += remaining * layer.alpha * layer.value;
      remaining *= 1.0 - layer.alpha;
    }
  }
  return vec4f(value, 1.0);
}
