// What a pixel of the viewport shows: the caller's G-buffer decoded where it is read (wgsl/receivers.wgsl decodes all of it
// beforehand, for passes that read it often).
//
// The importer declares `params` with `camera: Camera`, `normals: vec2u` (src/gbuffer.rs) and how far a stored depth may lie
// from the true one, an absolute part `depth_step` and one relative to the depth, `depth_relative`; and the textures
// `depth_texture` (post-projection) and `normal_texture`.

#needs params depth_texture normal_texture

#import math
#import packing
#import camera
#import gbuffer

struct Surface {
  // In the space that the camera's parameters are for.
  position: vec3f,
  normal: vec3f,
  sky: bool,
}

fn surface_at(pixel: vec2u) -> Surface {
  let at = params.camera.viewport.xy + pixel;
  let depth = textureLoad(depth_texture, at, 0).x;
  let p = unproject(params.camera, pixel, depth);
  if p.w == 0.0 {
    return Surface(vec3f(0.0), vec3f(0.0), true);
  }
  let texel = textureLoad(normal_texture, at, 0).xyz;
  let n = decode_normal(params.camera, params.normals, texel, normalize_or(params.camera.eye - p.xyz, vec3f(0.0, 0.0, 1.0)));
  // Where the depth's rounding moves the point by more than f32 does, the surface would shade itself: lift the point
  // off it by that much. Reversed depth in 32 bits needs next to nothing, 16-bit depth much.
  let step = params.depth_step + params.depth_relative * depth;
  let toward_eye = select(depth - step, depth + step, params.camera.far_depth == 0.0);
  let nearer = unproject(params.camera, pixel, toward_eye);
  let lift = select(0.0, distance(nearer.xyz, p.xyz), nearer.w != 0.0 && step > 0.0);
  return Surface(p.xyz + n * lift, n, false);
}
