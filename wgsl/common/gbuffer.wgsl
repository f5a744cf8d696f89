// The caller's G-buffer decoded (src/gbuffer.rs).

#import math
#import packing
#import camera

const UNSIGNED: u32 = 1u;
const OCTAHEDRAL: u32 = 2u;

// What lies farther from the eye is sky: squares of distances leave the range of f32 soon beyond.
const FARTHEST: f32 = 1e18;

fn is_near(p: vec3f) -> bool {
  return is_finite3(p) && max_component(abs(p)) < FARTHEST;
}

// The point that a depth stands for; w is 0 for the sky and what no camera can see.
fn unproject(camera: Camera, pixel: vec2u, depth: f32) -> vec4f {
  let size = vec2f(camera.viewport.zw);
  let ndc = (vec2f(pixel) + 0.5) / size * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
  let foreground = select((depth < 1.0), (depth > 0.0), camera.far_depth == 0.0);
  let h = unproject_by(camera, camera.unproject, ndc, depth);
  let p = h.xyz / h.w;
  return select(vec4f(0.0), vec4f(p, 1.0), foreground && is_finite(depth) && h.w > 0.0 && is_near(p));
}

// A unit normal along the axes that it is stored in; `none` where it has no direction. The encoding is UNSIGNED and
// OCTAHEDRAL, or not.
fn stored_normal(encoding: u32, texel: vec3f, none: vec3f) -> vec3f {
  var v = texel;
  if (encoding & UNSIGNED) != 0u {
    v = v * 2.0 - 1.0;
  }
  if (encoding & OCTAHEDRAL) != 0u {
    if !is_finite3(vec3f(v.xy, 0.0)) {
      return none;
    }
    v = octahedral_to(clamp(v.xy, vec2f(-1.0), vec2f(1.0)));
  }
  return normalize_or(v, none);
}

// A world-space unit normal; one that has no direction is taken to face the eye. The encoding's second half is 1 where
// normals are in view space.
fn decode_normal(camera: Camera, encoding: vec2u, texel: vec3f, to_eye: vec3f) -> vec3f {
  let n = stored_normal(encoding.x, texel, vec3f(0.0));
  // The camera's axes are unit vectors.
  let turned = select(n, camera.view_to_world * n, encoding.y != 0u);
  return select(turned, to_eye, all(n == vec3f(0.0)));
}
