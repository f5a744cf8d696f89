// Light from infinitely far away as sums of large terms need it: its mean over a part of the sky, from grids of which each is
// half as fine as the one before, and the irradiance of all of it (wgsl/environment.wgsl).

#import environment_cells

#needs environment environment_levels environment_irradiance

// The mean radiance of about a solid angle about a direction of the world, a unit vector: one cell of the grid whose cells are as
// high as a square of that solid angle is wide.
fn environment_mean(direction: vec3f, solid_angle: f32) -> vec3f {
  let size = environment.size;
  let finest = f32(size.y) / PI;
  let level = clamp(log2(max(sqrt(solid_angle) * finest, 1.0)) + 0.5, 0.0, f32(textureNumLevels(environment_levels)) - 0.5);
  let k = u32(level);
  let cell = environment_cell(direction * environment.to_world, max(size >> vec2u(k), vec2u(1u)));
  return textureLoad(environment_levels, cell, k).xyz;
}

// What a surface with this unit normal has of it without anything in its way, W/m^2, 0 or more.
fn environment_irradiance_at(normal: vec3f) -> vec3f {
  let d = normal * environment.to_world;
  let polynomials = array<f32, 9>(
    1.0, d.y, d.z, d.x, d.x * d.y, d.y * d.z, 3.0 * d.z * d.z - 1.0, d.x * d.z, d.x * d.x - d.y * d.y,
  );
  var sum = vec3f(0.0);
  for (var i = 0u; i < 9u; i++) {
    sum += environment_irradiance[i].xyz * polynomials[i];
  }
  return max(sum, vec3f(0.0));
}
