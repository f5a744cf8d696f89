// What a shader knows of the camera (src/camera.rs). Positions are in the eye space of the surfel cloud: axes of the
// world, origin at the eye that the cloud was made for.

struct Camera {
  // (ndc.x, ndc.y, depth - far_depth, 1) to homogeneous coordinates relative to this camera's eye.
  unproject: mat4x4f,
  view_to_world: mat3x3f,
  // This camera's eye in the cloud's eye space.
  eye: vec3f,
  // The depth of the background, 0 or 1.
  far_depth: f32,
  // x, y, width, height in pixels.
  viewport: vec4u,
  // Side of a pixel: at unit distance for a perspective camera, everywhere for an orthographic one.
  pixel: f32,
  near: f32,
  perspective: u32,
  padding: u32,
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
