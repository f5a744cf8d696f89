// What a shader knows of the camera (src/camera.rs). Positions are in the space of the surfel cloud: axes of the world, origin
// at the focus of the camera that the cloud was made for; or, without a cloud, at the camera's own.

struct Camera {
  // (ndc.x, ndc.y, depth - reference, 1) to homogeneous points; but their last coordinate is that of depth - far_depth.
  unproject: mat4x4f,
  view_to_world: mat3x3f,
  // This camera's eye.
  eye: vec3f,
  // The depth of the background, 0 or 1.
  far_depth: f32,
  // x, y, width, height in pixels.
  viewport: vec4u,
  // Side of a pixel: at unit distance for a perspective camera, everywhere for an orthographic one.
  pixel: f32,
  near: f32,
  perspective: u32,
  // The depth about the origin: near it nothing cancels.
  reference: f32,
}

// The lines of sight. Of (ndc.x, ndc.y, 1): where a line passes the plane across the axis through the origin, and its
// direction, 1 long along the axis.
struct Rays {
  base: mat3x3f,
  direction: mat3x3f,
}

// Homogeneous points of a matrix such as a camera's, given x, y and the depth.
fn unproject_by(camera: Camera, m: mat4x4f, at: vec2f, depth: f32) -> vec4f {
  let h = m * vec4f(at, depth - camera.reference, 1.0);
  return vec4f(h.xyz, dot(vec4f(m[0].w, m[1].w, m[2].w, m[3].w), vec4f(at, depth - camera.far_depth, 1.0)));
}

// Unit vector from a point relative to this camera's eye to where it is seen from.
fn to_camera(camera: Camera, relative: vec3f) -> vec3f {
  // Depth grows away from an orthographic camera, unless it is reversed.
  let axis = camera.unproject[2].xyz * select(-1.0, 1.0, camera.far_depth == 0.0);
  return normalize_or(select(axis, -relative, camera.perspective != 0u), vec3f(0.0, 0.0, 1.0));
}

// Side of a pixel at a point relative to this camera's eye, world units.
fn footprint(camera: Camera, relative: vec3f) -> f32 {
  return camera.pixel * select(1.0, max(length(relative), camera.near), camera.perspective != 0u);
}
