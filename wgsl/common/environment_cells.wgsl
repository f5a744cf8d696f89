// How an environment is turned, and the grid of latitude and longitude that its cells are of.

#import math

struct Environment {
  // Columns: its axes in the world.
  to_world: mat3x3f,
  // In cells.
  size: vec2u,
  // The grid of those of a pixel's directions that are drawn by the cosine; the others are drawn by the environment.
  columns: u32,
  rows: u32,
}

// Of a grid the cell that a unit vector of the environment's own axes lies in.
fn environment_cell(d: vec3f, cells: vec2u) -> vec2u {
  let size = vec2f(cells);
  let u = atan2(d.z, d.x) / (2.0 * PI) + 0.5;
  let v = atan2(length(d.xz), d.y) / PI;
  return min(vec2u(max(vec2f(u, v) * size, vec2f(0.0))), cells - 1u);
}
