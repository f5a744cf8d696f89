// Receivers: what the other passes read of the caller's G-buffer, decoded once: position in the cloud's eye space and
// shading normal (wgsl/common/receiver.wgsl), for the pixels of the viewport.
//
// @group(0) @binding(0) params, 1 depth (post-projection), 2 normals, 3 the receivers

#import math
#import packing
#import camera
#import receiver

struct Params {
  camera: Camera,
  normal_encoding: u32,
  // 1 where normals are in view space.
  normal_in_view: u32,
  // How far a stored depth may lie from the true one: an absolute part, and one relative to the depth.
  depth_step: f32,
  depth_relative: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var depth_texture: texture_2d<f32>;
@group(0) @binding(2) var normal_texture: texture_2d<f32>;
@group(0) @binding(3) var receivers: texture_storage_2d<rgba32uint, write>;

const UNSIGNED: u32 = 1u;
const OCTAHEDRAL: u32 = 2u;

// What lies farther from the eye is sky: squares of distances leave the range of f32 soon beyond.
const FARTHEST: f32 = 1e18;

fn is_near(p: vec3f) -> bool {
  return is_finite3(p) && max_component(abs(p)) < FARTHEST;
}

// The point that a depth stands for, relative to the camera's eye; w is 0 for the sky and what no camera can see.
fn unproject(pixel: vec2u, depth: f32) -> vec4f {
  let size = vec2f(params.camera.viewport.zw);
  let ndc = (vec2f(pixel) + 0.5) / size * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
  let foreground = select((depth < 1.0), (depth > 0.0), params.camera.far_depth == 0.0);
  let h = params.camera.unproject * vec4f(ndc, depth - params.camera.far_depth, 1.0);
  let p = h.xyz / h.w;
  return select(vec4f(0.0), vec4f(p, 1.0), foreground && is_finite(depth) && h.w > 0.0 && is_near(p));
}

// A world-space unit normal; one that has no direction is taken to face the eye.
fn decode_normal(texel: vec3f, to_eye: vec3f) -> vec3f {
  var v = texel;
  if (params.normal_encoding & UNSIGNED) != 0u {
    v = v * 2.0 - 1.0;
  }
  if (params.normal_encoding & OCTAHEDRAL) != 0u {
    if !is_finite3(vec3f(v.xy, 0.0)) {
      return to_eye;
    }
    v = octahedral_to(clamp(v.xy, vec2f(-1.0), vec2f(1.0)));
  }
  let n = normalize_or(v, vec3f(0.0));
  if params.normal_in_view != 0u {
    return normalize_or(params.camera.view_to_world * n, to_eye);
  }
  return normalize_or(n, to_eye);
}

@compute @workgroup_size(8, 8)
fn prepare(@builtin(global_invocation_id) id: vec3u) {
  if any(id.xy >= params.camera.viewport.zw) {
    return;
  }
  let at = params.camera.viewport.xy + id.xy;
  let depth = textureLoad(depth_texture, at, 0).x;
  let p = unproject(id.xy, depth);
  if p.w == 0.0 {
    textureStore(receivers, id.xy, vec4u(0u, 0u, 0u, SKY));
    return;
  }
  let n = decode_normal(textureLoad(normal_texture, at, 0).xyz, normalize_or(-p.xyz, vec3f(0.0, 0.0, 1.0)));
  // Where the depth's rounding moves the point by more than f32 does, the surface would shade itself: lift the point
  // off it by that much. Reversed depth in 32 bits needs next to nothing, 16-bit depth much.
  let step = params.depth_step + params.depth_relative * depth;
  let toward_eye = select(depth - step, depth + step, params.camera.far_depth == 0.0);
  let nearer = unproject(id.xy, toward_eye);
  let lift = select(0.0, distance(nearer.xyz, p.xyz), nearer.w != 0.0 && step > 0.0);
  let position = p.xyz + params.camera.eye + n * lift;
  textureStore(receivers, id.xy, vec4u(bitcast<vec3u>(position), pack_normal(n)));
}
