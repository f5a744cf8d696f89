// Receivers: what the other passes read of the caller's G-buffer, decoded once: position in the cloud's space and
// shading normal (wgsl/common/receiver.wgsl), for the pixels of the viewport. With LIST, of a sub-image: for those of its
// pixels that are listed; to the passes that follow, the others are the sky.
//
//   prepare  one thread per pixel
//   erase    with LIST, before it: all of the sub-image's pixels
//
// @group(0) @binding(0) params, 1 depth (post-projection), 2 normals, 3 the receivers, 4 the list

#import surface
#import receiver

struct Params {
  camera: Camera,
  // How normals are stored (src/gbuffer.rs).
  normals: vec2u,
  // How far a stored depth may lie from the true one: an absolute part, and one relative to the depth.
  depth_step: f32,
  depth_relative: f32,
#if LIST
  // The sub-image.
  level: u32,
  padding0: u32,
  padding1: u32,
  padding2: u32,
#endif
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var depth_texture: texture_2d<f32>;
@group(0) @binding(2) var normal_texture: texture_2d<f32>;
@group(0) @binding(3) var receivers: texture_storage_2d<rgba32uint, write>;

fn texel_of(pixel: vec2u) -> vec4u {
  let surface = surface_at(pixel);
  let shown = vec4u(bitcast<vec3u>(surface.position), pack_normal(surface.normal));
  return select(shown, vec4u(0u, 0u, 0u, SKY), surface.sky);
}

#if LIST

#import work

@group(0) @binding(4) var<storage, read> work: array<u32>;

@compute @workgroup_size(8, 8)
fn erase(@builtin(global_invocation_id) id: vec3u) {
  if all(id.xy < textureDimensions(receivers)) {
    textureStore(receivers, id.xy, vec4u(0u, 0u, 0u, SKY));
  }
}

@compute @workgroup_size(8, 8)
fn prepare(
  @builtin(workgroup_id) workgroup: vec3u,
  @builtin(num_workgroups) workgroups: vec3u,
  @builtin(local_invocation_index) local_index: u32,
) {
  let item = work_item(workgroup, workgroups, local_index);
  if item.valid {
    textureStore(receivers, item.texel, texel_of(item.pixel));
  }
}

#else

@compute @workgroup_size(8, 8)
fn prepare(@builtin(global_invocation_id) id: vec3u) {
  if all(id.xy < params.camera.viewport.zw) {
    textureStore(receivers, id.xy, texel_of(id.xy));
  }
}

#endif
