// Receivers: what the other passes read of the caller's G-buffer, decoded once: position in the cloud's eye space and
// shading normal (wgsl/common/receiver.wgsl), for the pixels of the viewport.
//
// @group(0) @binding(0) params, 1 depth (post-projection), 2 normals, 3 the receivers

#import surface
#import receiver

struct Params {
  camera: Camera,
  // How normals are stored (src/gbuffer.rs).
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
  let surface = surface_at(id.xy);
  var texel = vec4u(0u, 0u, 0u, SKY);
  if !surface.sky {
    texel = vec4u(bitcast<vec3u>(surface.position), pack_normal(surface.normal));
  }
  textureStore(receivers, id.xy, texel);
}
