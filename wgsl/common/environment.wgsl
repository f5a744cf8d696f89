// Light from infinitely far away, as cells of a latitude-longitude grid: constant in each, and drawn in proportion to what comes
// from there (Pharr, Jakob and Humphreys, Physically Based Rendering, 4th ed. 2023, 12.5.2; wgsl/environment.wgsl).
//
// Rows go from +Y down to -Y; in the middle of each lies +X, and +Z a quarter of the row to the right of it.

#import environment_cells

#needs environment environment_radiance environment_distribution

// A direction that is drawn by the environment, and what comes from there.
struct EnvironmentSample {
  // In the world.
  direction: vec3f,
  radiance: vec3f,
  // Density over solid angle with which it is drawn.
  pdf: f32,
}

// Of a row its share of all, and where it begins; in the last row of the texture each row's end.
fn row_range(row: u32) -> vec2f {
  let end = textureLoad(environment_distribution, vec2u(row, environment.size.y), 0).x;
  let begin = textureLoad(environment_distribution, vec2u(max(row, 1u) - 1u, environment.size.y), 0).x;
  return vec2f(select(begin, 0.0, row == 0u), end);
}

// The same of a cell in its row.
fn cell_range(cell: vec2u) -> vec2f {
  let end = textureLoad(environment_distribution, cell, 0).x;
  let begin = textureLoad(environment_distribution, vec2u(max(cell.x, 1u) - 1u, cell.y), 0).x;
  return vec2f(select(begin, 0.0, cell.x == 0u), end);
}

// Cosines of the polar angles that a row begins and ends at.
fn row_heights(row: u32) -> vec2f {
  return cos(PI * vec2f(f32(row), f32(row + 1u)) / f32(environment.size.y));
}

// The solid angle of a cell. In this form nothing cancels.
fn cell_solid_angle(row: u32) -> f32 {
  let size = vec2f(environment.size);
  return 4.0 * PI / size.x * sin(PI * (f32(row) + 0.5) / size.y) * sin(0.5 * PI / size.y);
}

fn cell_pdf(cell: vec2u, row: vec2f, column: vec2f) -> f32 {
  return (row.y - row.x) * (column.y - column.x) / cell_solid_angle(cell.y);
}

// What comes from a direction of the world, a unit vector, and the density with which it is drawn.
fn environment_at(direction: vec3f) -> EnvironmentSample {
  let cell = environment_cell(direction * environment.to_world, environment.size);
  let pdf = cell_pdf(cell, row_range(cell.y), cell_range(cell));
  return EnvironmentSample(direction, textureLoad(environment_radiance, cell, 0).xyz, pdf);
}

// The first of `count` texels from `from` on along a row whose value is larger than x; the last one at most.
fn find_texel(from_texel: vec2u, count: u32, x: f32) -> u32 {
  var low = 0u;
  var high = count - 1u;
  while low < high {
    let middle = (low + high) / 2u;
    let end = textureLoad(environment_distribution, from_texel + vec2u(middle, 0u), 0).x;
    if end > x {
      high = middle;
    } else {
      low = middle + 1u;
    }
  }
  return low;
}

// A point of the unit square, each coordinate below 1, to a direction: y picks the row and x the cell, and where in them.
fn environment_sample(point: vec2f) -> EnvironmentSample {
  let size = environment.size;
  var cell: vec2u;
  cell.y = find_texel(vec2u(0u, size.y), size.y, point.y);
  cell.x = find_texel(vec2u(0u, cell.y), size.x, point.x);
  let row = row_range(cell.y);
  let column = cell_range(cell);
  let within = vec2f(
    (point.x - column.x) / max(column.y - column.x, 1e-30),
    (point.y - row.x) / max(row.y - row.x, 1e-30),
  );
  let inside = clamp(within, vec2f(0.0), vec2f(1.0));
  let heights = row_heights(cell.y);
  let height = mix(heights.x, heights.y, inside.y);
  let angle = 2.0 * PI * ((f32(cell.x) + inside.x) / f32(size.x) - 0.5);
  let d = vec3f(vec2f(cos(angle), sin(angle)) * sqrt(max((1.0 - height) * (1.0 + height), 0.0)), height);
  let direction = environment.to_world * d.xzy;
  return EnvironmentSample(direction, textureLoad(environment_radiance, cell, 0).xyz, cell_pdf(cell, row, column));
}
