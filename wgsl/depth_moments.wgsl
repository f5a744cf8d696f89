// Moments of view depth, counted from the camera's focus, over squares of 2 x 2, 4 x 4 ... pixels: what area samples of
// volumetric obscurance read (Volumetric Obscurance 4.2; wgsl/common/moments.wgsl).
//
// With DEPTH the first level is made of the depth buffer, without it each further one of that before.
//
// @group(0) @binding(0) params, 1 all levels, 2 depth (post-projection; with DEPTH)

#import math
#import camera
#import moments
#if DEPTH
#import packing
#import gbuffer
#endif

struct Params {
  camera: Camera,
  // Unit vector along which view depth grows.
  forward: vec3f,
  padding: u32,
  fine: MomentLevel,
  coarse: MomentLevel,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> moments: array<vec4f>;
#if DEPTH
@group(0) @binding(2) var depth_texture: texture_2d<f32>;
#endif

fn fine_moments(texel: vec2u) -> vec4f {
  if any(texel >= params.fine.size) {
    return vec4f(0.0);
  }
#if DEPTH
  let depth = textureLoad(depth_texture, params.camera.viewport.xy + texel, 0).x;
  let p = unproject(params.camera, texel, depth);
  return vec4f(dot(p.xyz, params.forward), 0.0, p.w, 1.0);
#else
  return moments[params.fine.offset + texel.y * params.fine.size.x + texel.x];
#endif
}

@compute @workgroup_size(8, 8)
fn halve(@builtin(global_invocation_id) id: vec3u) {
  if any(id.xy >= params.coarse.size) {
    return;
  }
  let corner = 2u * id.xy;
  moments[params.coarse.offset + id.y * params.coarse.size.x + id.x] = merge_moments(
    fine_moments(corner), fine_moments(corner + vec2u(1u, 0u)),
    fine_moments(corner + vec2u(0u, 1u)), fine_moments(corner + vec2u(1u, 1u)), vec4f(0.25));
}
