// MultiResReconstructor: one image of the sub-images that an effect computed for a MultiResMask (Besenthal et al. 2019,
// 3.3 and 4.2).
//
// Of level i the mask a_i, times the weight w_i, says how much its image counts over what the coarser levels give:
//   c'_i = c_i min(a_i w_i, 1) + c'_(i+1) (1 - min(a_i w_i, 1))
// from the coarsest level, which is complete, to the finest; each at its own level's resolution, so that a pixel asks four
// pixels of one coarser image.
//
//   complete  of a level, all pixels: its own image where that counts alone, or else what the next coarser image gives
//   mend      of a level, those listed pixels that are blended of both
//   blend     fragment: as `complete` all pixels of the image, and what was mended of them
//
// Between the pixels of a coarser image values are bilinear, of those that lie on the pixel's own surface.

#import surface
#import sub_image
#import block
#if BLEND
#import screen
#endif

// Whether all pixels about one are on its surface, unless it is listed.
override ALIKE: bool = false;

struct Params {
  camera: Camera,
  normals: vec2u,
  depth_step: f32,
  depth_relative: f32,
  // The level that is computed, and that of the coarser image.
  level: u32,
  coarser: u32,
  weight: f32,
  // How far off a pixel's tangent plane a neighbour may lie, in pixels of the coarser image.
  plane_distance: f32,
  // Exponent of the cosine between normals, 8 or more.
  normal_power: f32,
  // 1 where there is a finest level of its own.
  has_own: u32,
  // From which mask on the level's own image counts alone.
  whole_from: f32,
  padding: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var depth_texture: texture_2d<f32>;
@group(0) @binding(2) var normal_texture: texture_2d<f32>;
// The next coarser level, completed.
@group(0) @binding(3) var coarse: texture_2d<f32>;
@group(0) @binding(4) var mask: texture_2d<f32>;
// What the effect computed.
@group(0) @binding(5) var own: texture_2d<f32>;
#if BLEND
@group(0) @binding(6) var mended: texture_2d<f32>;
#else
// How many, then x | y << 16 of each.
@group(0) @binding(6) var<storage, read> work: array<u32>;
#if COLOR
@group(0) @binding(7) var result: texture_storage_2d<rgba16float, write>;
#else
@group(0) @binding(7) var result: texture_storage_2d<r32float, write>;
#endif
// A dispatch for the blended pixels, and how many come before them.
@group(0) @binding(8) var<storage, read> blended: array<u32, 4>;
#endif

// What a neighbour on another surface counts: all there is where no other is.
const STRANGER: f32 = 1e-4;

#if COLOR

alias Value = vec3f;

fn value_of(texel: vec4f) -> Value {
  return texel.xyz;
}

fn is_sound(value: Value) -> bool {
  return is_finite3(value);
}

fn texel_of(value: Value) -> vec4f {
  return vec4f(value, 1.0);
}

#else

alias Value = f32;

fn value_of(texel: vec4f) -> Value {
  return texel.x;
}

fn is_sound(value: Value) -> bool {
  return is_finite(value);
}

fn texel_of(value: Value) -> vec4f {
  return vec4f(value, value, value, 1.0);
}

#endif

// The four pixels of the coarser image about a pixel, and how near they are.
struct Corners {
  texels: array<vec2u, 4>,
  shares: vec4f,
}

fn corners_about(pixel: vec2u) -> Corners {
  let level = params.coarser;
  let size = params.camera.viewport.zw;
  let end = (size - 1u) >> vec2u(level);
  let half = (1u << level) >> 1u;
  let first = min((max(pixel, vec2u(half)) - half) >> vec2u(level), end);
  let last = min(first + 1u, end);
  // The last pixel of a sub-image may stand for one nearer than the others do.
  let start = stands_for(first, level, size);
  let extent = vec2f(stands_for(last, level, size) - start);
  let share = clamp((vec2f(pixel) - vec2f(start)) / max(extent, vec2f(1.0)), vec2f(0.0), vec2f(1.0));
  let columns = vec2f(1.0 - share.x, share.x);
  return Corners(
    array(first, vec2u(last.x, first.y), vec2u(first.x, last.y), last),
    vec4f(columns * (1.0 - share.y), columns * share.y),
  );
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

// How much of each corner is on a pixel's surface.
fn similarities(pixel: vec2u, texels: array<vec2u, 4>) -> vec4f {
  let p = surface_at(pixel);
  let reach =
    params.plane_distance * f32(1u << params.coarser) * footprint(params.camera, p.position - params.camera.eye);
  let level = params.coarser;
  let size = params.camera.viewport.zw;
  return vec4f(
    similarity(p, surface_at(stands_for(texels[0], level, size)), reach),
    similarity(p, surface_at(stands_for(texels[1], level, size)), reach),
    similarity(p, surface_at(stands_for(texels[2], level, size)), reach),
    similarity(p, surface_at(stands_for(texels[3], level, size)), reach),
  );
}

// What the coarser image gives at a pixel; 0 where it has nothing finite.
fn coarser_at(pixel: vec2u, alike: bool) -> Value {
  let corners = corners_about(pixel);
  let a = value_of(textureLoad(coarse, corners.texels[0], 0));
  let b = value_of(textureLoad(coarse, corners.texels[1], 0));
  let c = value_of(textureLoad(coarse, corners.texels[2], 0));
  let d = value_of(textureLoad(coarse, corners.texels[3], 0));
  var weights = corners.shares;
  if !alike {
    weights *= similarities(pixel, corners.texels) + STRANGER;
  }
  let are_sound = vec4<bool>(is_sound(a), is_sound(b), is_sound(c), is_sound(d));
  weights = select(vec4f(0.0), weights, are_sound);
  let none = Value();
  let sum = select(none, a, are_sound.x) * weights.x + select(none, b, are_sound.y) * weights.y
    + select(none, c, are_sound.z) * weights.z + select(none, d, are_sound.w) * weights.w;
  return sum / max(dot(weights, vec4f(1.0)), 1e-30);
}

// The mask of a level's pixel; 0 where there is no such level.
fn mask_at(texel: vec2u) -> f32 {
  if params.has_own == 0u {
    return 0.0;
  }
  return of_block(textureLoad(mask, texel >> vec2u(1u), 0), texel);
}

#if BLEND

@fragment
fn blend(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  let size = vec2i(params.camera.viewport.zw);
  let pixel = vec2u(clamp(vec2i(fragment.xy) - vec2i(params.camera.viewport.xy), vec2i(0), size - 1));
  let a = mask_at(pixel);
  // Where there is no finest level a smaller texture stands for it.
  let texel = select(vec2u(0u), pixel, a > 0.0);
  let value = value_of(textureLoad(own, texel, 0));
  if a >= params.whole_from && is_sound(value) {
    return held(texel_of(value));
  }
  if a > 0.0 && a < params.whole_from {
    return held(texel_of(value_of(textureLoad(mended, texel, 0))));
  }
  return held(texel_of(coarser_at(pixel, ALIKE)));
}

#else

@compute @workgroup_size(8, 8)
fn complete(@builtin(global_invocation_id) id: vec3u) {
  let size = params.camera.viewport.zw;
  if any(id.xy > ((size - 1u) >> vec2u(params.level))) {
    return;
  }
  var value = value_of(textureLoad(own, id.xy, 0));
  if mask_at(id.xy) < params.whole_from || !is_sound(value) {
    value = coarser_at(stands_for(id.xy, params.level, size), ALIKE);
  }
  textureStore(result, id.xy, texel_of(value));
}

@compute @workgroup_size(64)
fn mend(
  @builtin(workgroup_id) workgroup: vec3u,
  @builtin(num_workgroups) workgroups: vec3u,
  @builtin(local_invocation_index) local: u32,
) {
  let i = blended[3] + (workgroup.y * workgroups.x + workgroup.x) * 64u + local;
  if i >= work[0] {
    return;
  }
  let texel = vec2u(work[i + 1u] & 0xffffu, work[i + 1u] >> 16u);
  let value = value_of(textureLoad(own, texel, 0));
  // What is not finite counts as not computed.
  let alpha = select(0.0, min(mask_at(texel) * params.weight, 1.0), is_sound(value));
  let coarser = coarser_at(stands_for(texel, params.level, params.camera.viewport.zw), false);
  textureStore(result, texel, texel_of(select(Value(), value, is_sound(value)) * alpha + coarser * (1.0 - alpha)));
}

#endif
