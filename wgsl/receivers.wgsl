// Receivers: what the other passes read of the caller's G-buffer, decoded once: position in the cloud's eye space and
// shading normal (wgsl/common/receiver.wgsl), for the pixels of the viewport.
//
// @group(0) @binding(0) params, 1 depth (post-projection), 2 normals, 3 the receivers

#import math
#import packing
#import camera
#import gbuffer
#import receiver

struct Params {
  camera: Camera,
  // Their encoding, as decode_normal takes it.
  normals: vec2u,
  // How far a stored depth may lie from the true one: an absolute part, and one relative to the depth.
  depth_step: f32,
  depth_relative: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var depth_texture: texture_2d<f32>;
@group(0) @binding(2) var normal_texture: texture_2d<f32>;
@group(0) @binding(3) var receivers: texture_storage_2d<rgba32uint, write>;

@compute @workgroup_size(8, 8)
fn prepare(@builtin(global_invocation_id) id: vec3u) {
  if any(id.xy >= params.camera.viewport.zw) {
    return;
  }
  let at = params.camera.viewport.xy + id.xy;
  let depth = textureLoad(depth_texture, at, 0).x;
  let p = unproject(params.camera, id.xy, depth);
  if p.w == 0.0 {
    textureStore(receivers, id.xy, vec4u(0u, 0u, 0u, SKY));
    return;
  }
  let to_eye = normalize_or(-p.xyz, vec3f(0.0, 0.0, 1.0));
  let n = decode_normal(params.camera, params.normals, textureLoad(normal_texture, at, 0).xyz, to_eye);
  // Where the depth's rounding moves the point by more than f32 does, the surface would shade itself: lift the point
  // off it by that much. Reversed depth in 32 bits needs next to nothing, 16-bit depth much.
  let step = params.depth_step + params.depth_relative * depth;
  let toward_eye = select(depth - step, depth + step, params.camera.far_depth == 0.0);
  let nearer = unproject(params.camera, id.xy, toward_eye);
  let lift = select(0.0, distance(nearer.xyz, p.xyz), nearer.w != 0.0 && step > 0.0);
  let position = p.xyz + params.camera.eye + n * lift;
  textureStore(receivers, id.xy, vec4u(bitcast<vec3u>(position), pack_normal(n)));
}
