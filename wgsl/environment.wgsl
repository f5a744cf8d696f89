// EnvironmentBuilder: what rays look up and draw of an environment (wgsl/common/environment.wgsl), and the irradiance that it
// gives without anything in its way.
//
//   cells        one thread per cell: the mean radiance of what the source has there
//   rows         one thread per row: the distribution over its cells, and what all of it is worth
//   columns      one thread: the distribution over rows
//   irradiance   one workgroup: order-2 spherical harmonics (Ramamoorthi and Hanrahan, An Efficient Representation for
//                Irradiance Environment Maps, 2001)
//
// The source is a picture of latitude and longitude, as the cells are. With #if SUMMED it is instead a sum of spherical
// harmonics and of spherical Gaussians, and a cell has the value in its middle.

#import math
#if SUMMED
#import spherical_gaussian
#endif

struct Params {
  // In cells, and in texels of the source.
  size: vec2u,
  source_size: vec2u,
}

#if SUMMED
struct Lobes {
  // Coefficients of the real spherical harmonics of orders 0 to 2.
  harmonics: array<vec4f, 9>,
  // Axis and sharpness, amplitude.
  lobes: array<Lobe, 16>,
  count: u32,
}

struct Lobe {
  axis: vec3f,
  sharpness: f32,
  amplitude: vec3f,
}
#endif

@group(0) @binding(0) var<uniform> params: Params;
#if SUMMED
@group(0) @binding(1) var<uniform> source: Lobes;
#else
@group(0) @binding(1) var source: texture_2d<f32>;
#endif
@group(0) @binding(2) var radiance_out: texture_storage_2d<rgba32float, write>;
@group(0) @binding(3) var radiance: texture_2d<f32>;
@group(0) @binding(4) var distribution: texture_storage_2d<r32float, write>;
@group(0) @binding(5) var<storage, read_write> row_powers: array<f32>;
// Of the polynomials 1, y, z, x, xy, yz, 3z^2 - 1, xz, x^2 - y^2 of a unit normal.
@group(0) @binding(6) var<storage, read_write> irradiance_out: array<vec4f, 9>;

// The brightest that counts.
const MOST_RADIANCE: f32 = 1e18;

// What is not a number or negative counts as 0. By its bits, see is_finite.
fn clean(color: vec3f) -> vec3f {
  let is_nan = (bitcast<vec3u>(color) & vec3u(0x7fffffffu)) > vec3u(0x7f800000u);
  return clamp(select(color, vec3f(0.0), is_nan), vec3f(0.0), vec3f(MOST_RADIANCE));
}

// The solid angle between two polar angles, over 4 pi; in this form nothing cancels.
fn belt(begin: f32, end: f32) -> f32 {
  return sin(0.5 * (begin + end)) * sin(0.5 * max(end - begin, 0.0));
}

#if SUMMED

// Unit vector to the middle of a cell.
fn cell_direction(cell: vec2u) -> vec3f {
  let polar = PI * (f32(cell.y) + 0.5) / f32(params.size.y);
  let angle = 2.0 * PI * ((f32(cell.x) + 0.5) / f32(params.size.x) - 0.5);
  return vec3f(cos(angle) * sin(polar), cos(polar), sin(angle) * sin(polar));
}

fn cell_radiance(cell: vec2u) -> vec3f {
  let d = cell_direction(cell);
  let basis = harmonics_at(d);
  var sum = vec3f(0.0);
  for (var i = 0u; i < 9u; i++) {
    sum += source.harmonics[i].xyz * basis[i];
  }
  for (var i = 0u; i < source.count; i++) {
    let lobe = source.lobes[i];
    let shape = SphericalGaussian(lobe.axis, lobe.sharpness);
    sum += lobe.amplitude * sg_evaluate(shape, d);
  }
  return clean(sum);
}

#else

// The mean over the source's texels, each by how much of it lies in the cell.
fn cell_radiance(cell: vec2u) -> vec3f {
  let scale = vec2f(params.source_size) / vec2f(params.size);
  let low = vec2f(cell) * scale;
  let high = vec2f(cell + 1u) * scale;
  let last = vec2u(ceil(high) - 1.0);
  var sum = vec3f(0.0);
  var weights = 0.0;
  let per_row = PI / f32(params.source_size.y);
  for (var y = u32(low.y); y <= min(last.y, params.source_size.y - 1u); y++) {
    let height = belt(max(f32(y), low.y) * per_row, min(f32(y + 1u), high.y) * per_row);
    for (var x = u32(low.x); x <= min(last.x, params.source_size.x - 1u); x++) {
      let width = max(min(f32(x + 1u), high.x) - max(f32(x), low.x), 0.0);
      let weight = height * width;
      sum += weight * clean(textureLoad(source, vec2u(x, y), 0).xyz);
      weights += weight;
    }
  }
  return sum / max(weights, 1e-30);
}

#endif

@compute @workgroup_size(8, 8)
fn cells(@builtin(global_invocation_id) id: vec3u) {
  if all(id.xy < params.size) {
    textureStore(radiance_out, id.xy, vec4f(cell_radiance(id.xy), 1.0));
  }
}

// What directions are drawn in proportion to: all channels alike, so that no colour is rare.
fn power(cell: vec2u) -> f32 {
  let color = textureLoad(radiance, cell, 0).xyz;
  return (color.x + color.y + color.z) / 3.0;
}

@compute @workgroup_size(64)
fn rows(@builtin(global_invocation_id) id: vec3u) {
  let row = id.x;
  if row >= params.size.y {
    return;
  }
  var total = 0.0;
  for (var x = 0u; x < params.size.x; x++) {
    total += power(vec2u(x, row));
  }
  row_powers[row] = total / f32(params.size.x);
  var sum = 0.0;
  for (var x = 0u; x < params.size.x; x++) {
    sum += power(vec2u(x, row));
    // A black row is drawn evenly, if it is drawn at all.
    let end = select(f32(x + 1u) / f32(params.size.x), sum / max(total, 1e-30), total > 1e-30);
    textureStore(distribution, vec2u(x, row), vec4f(end));
  }
}

@compute @workgroup_size(1)
fn columns() {
  let per_row = PI / f32(params.size.y);
  var total = 0.0;
  var whole = 0.0;
  for (var y = 0u; y < params.size.y; y++) {
    let height = belt(f32(y) * per_row, f32(y + 1u) * per_row);
    total += height * row_powers[y];
    whole += height;
  }
  var sum = 0.0;
  var height_sum = 0.0;
  for (var y = 0u; y < params.size.y; y++) {
    let height = belt(f32(y) * per_row, f32(y + 1u) * per_row);
    sum += height * row_powers[y];
    height_sum += height;
    let end = select(height_sum / whole, sum / max(total, 1e-30), total > 1e-30);
    textureStore(distribution, vec2u(y, params.size.y), vec4f(end));
  }
}

// The real spherical harmonics of orders 0 to 2, their constants as Ramamoorthi and Hanrahan print them.
fn harmonics_at(d: vec3f) -> array<f32, 9> {
  return array<f32, 9>(
    0.282094792, 0.488602512 * d.y, 0.488602512 * d.z, 0.488602512 * d.x,
    1.092548431 * d.x * d.y, 1.092548431 * d.y * d.z, 0.315391565 * (3.0 * d.z * d.z - 1.0),
    1.092548431 * d.x * d.z, 0.546274215 * (d.x * d.x - d.y * d.y),
  );
}

var<workgroup> sums: array<array<vec3f, 9>, 64>;

// What a coefficient of radiance is worth in irradiance (their equation 8), times the basis's own constant where the polynomial
// lacks it: irradiance is the sum of coefficients times polynomials.
fn convolved(index: u32) -> f32 {
  let basis = array<f32, 9>(
    0.282094792, 0.488602512, 0.488602512, 0.488602512, 1.092548431, 1.092548431, 0.315391565, 1.092548431, 0.546274215,
  );
  let order = select(select(PI / 4.0, 2.0 * PI / 3.0, index < 4u), PI, index == 0u);
  return order * basis[index];
}

@compute @workgroup_size(64)
fn irradiance(@builtin(local_invocation_index) thread: u32) {
  var own: array<vec3f, 9>;
  for (var y = 0u; y < params.size.y; y++) {
    let polar = PI * (f32(y) + 0.5) / f32(params.size.y);
    let per_row = PI / f32(params.size.y);
    let solid_angle = 4.0 * PI / f32(params.size.x) * belt(f32(y) * per_row, f32(y + 1u) * per_row);
    for (var x = thread; x < params.size.x; x += 64u) {
      let angle = 2.0 * PI * ((f32(x) + 0.5) / f32(params.size.x) - 0.5);
      let d = vec3f(cos(angle) * sin(polar), cos(polar), sin(angle) * sin(polar));
      let basis = harmonics_at(d);
      let color = textureLoad(radiance, vec2u(x, y), 0).xyz * solid_angle;
      for (var i = 0u; i < 9u; i++) {
        own[i] += basis[i] * color;
      }
    }
  }
  sums[thread] = own;
  workgroupBarrier();
  for (var half = 32u; half > 0u; half /= 2u) {
    if thread < half {
      for (var i = 0u; i < 9u; i++) {
        sums[thread][i] += sums[thread + half][i];
      }
    }
    workgroupBarrier();
  }
  if thread < 9u {
    irradiance_out[thread] = vec4f(convolved(thread) * sums[0][thread], 0.0);
  }
}
