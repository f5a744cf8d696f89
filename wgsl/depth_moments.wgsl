// Moments of view depth over squares of 2 x 2, 4 x 4 ... pixels: what area samples of volumetric obscurance read
// (Volumetric Obscurance 4.2; wgsl/common/moments.wgsl).
//
// With DEPTH the first level is made of the depth buffer, without it each further one of that before.
//
// @group(0) @binding(0) the level to write, 1 what it is made of, 2 params (with DEPTH)

#import math
#import moments
#if DEPTH
#import packing
#import camera
#import gbuffer

struct Params {
  camera: Camera,
  // Unit vector along which view depth grows.
  forward: vec3f,
  padding: u32,
}
#endif

@group(0) @binding(0) var coarse: texture_storage_2d<rgba32float, write>;
@group(0) @binding(1) var fine: texture_2d<f32>;
#if DEPTH
@group(0) @binding(2) var<uniform> params: Params;

// Of one pixel.
fn fine_moments(pixel: vec2u) -> vec4f {
  if any(pixel >= params.camera.viewport.zw) {
    return vec4f(0.0);
  }
  let depth = textureLoad(fine, params.camera.viewport.xy + pixel, 0).x;
  let p = unproject(params.camera, pixel, depth);
  return vec4f(dot(p.xyz, params.forward), 0.0, p.w, 1.0);
}
#else

fn fine_moments(texel: vec2u) -> vec4f {
  return textureLoad(fine, texel, 0);
}
#endif

@compute @workgroup_size(8, 8)
fn halve(@builtin(global_invocation_id) id: vec3u) {
  if any(id.xy >= textureDimensions(coarse)) {
    return;
  }
  let corner = 2u * id.xy;
  let merged = merge_moments(
    fine_moments(corner), fine_moments(corner + vec2u(1u, 0u)),
    fine_moments(corner + vec2u(0u, 1u)), fine_moments(corner + vec2u(1u, 1u)), vec4f(0.25));
  textureStore(coarse, id.xy, merged);
}
