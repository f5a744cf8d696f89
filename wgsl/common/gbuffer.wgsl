// The caller's G-buffer decoded a pixel at a time: position in the cloud's eye space and shading normal.
//
// Asks of its importer `params` with `camera: Camera`, `normal_encoding`, `normal_in_view`, `depth_step` and
// `depth_relative` as below, and the textures `depth_texture` (post-projection) and `normal_texture`:
//   normal_encoding   the bits UNSIGNED and OCTAHEDRAL
//   normal_in_view    1 where normals are in view space
//   depth_step, depth_relative   how far a stored depth may lie from the true one: an absolute part, and one relative
//                     to the depth

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

fn is_foreground(depth: f32) -> bool {
  return is_finite(depth) && select((depth < 1.0), (depth > 0.0), params.camera.far_depth == 0.0);
}

// Homogeneous coordinates of a pixel's middle at a depth, relative to the camera's eye.
fn homogeneous(pixel: vec2u, depth: f32) -> vec4f {
  let size = vec2f(params.camera.viewport.zw);
  let ndc = (vec2f(pixel) + 0.5) / size * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
  return params.camera.unproject * vec4f(ndc, depth - params.camera.far_depth, 1.0);
}

// The point that a depth stands for, relative to the camera's eye; w is 0 for the sky and what no camera can see.
fn unproject(pixel: vec2u, depth: f32) -> vec4f {
  let h = homogeneous(pixel, depth);
  let p = h.xyz / h.w;
  return select(vec4f(0.0), vec4f(p, 1.0), is_foreground(depth) && h.w > 0.0 && is_near(p));
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

// What a pixel of the viewport shows.
struct Surface {
  // In the cloud's eye space.
  position: vec3f,
  normal: vec3f,
  sky: bool,
}

fn surface_at(pixel: vec2u) -> Surface {
  let at = params.camera.viewport.xy + pixel;
  let depth = textureLoad(depth_texture, at, 0).x;
  let p = unproject(pixel, depth);
  if p.w == 0.0 {
    return Surface(vec3f(0.0), vec3f(0.0), true);
  }
  let n = decode_normal(textureLoad(normal_texture, at, 0).xyz, normalize_or(-p.xyz, vec3f(0.0, 0.0, 1.0)));
  // Where the depth's rounding moves the point by more than f32 does, the surface would shade itself: lift the point
  // off it by that much. Reversed depth in 32 bits needs next to nothing, 16-bit depth much.
  let step = params.depth_step + params.depth_relative * depth;
  let toward_eye = select(depth - step, depth + step, params.camera.far_depth == 0.0);
  let nearer = unproject(pixel, toward_eye);
  let lift = select(0.0, distance(nearer.xyz, p.xyz), nearer.w != 0.0 && step > 0.0);
  return Surface(p.xyz + params.camera.eye + n * lift, n, false);
}
