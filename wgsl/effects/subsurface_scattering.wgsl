// Light that enters a body at a surfel and leaves it at a pixel, by the dipole of Jensen et al. (2001, equation 4), each channel
// by itself. The sum is the radiant exitance over pi.
//
// A surfel is no point: close to it, light comes out as if the surfel's light were spread over its surroundings. With
//
//   K(z) = z (1 + sigma rho) exp(-sigma rho) / (2 pi rho^3),   rho^2 = distance^2 + z^2,
//
// the profile is gain / 2 (K(z_r) + K(z_v)). K(z) has the integral exp(-sigma z) over the plane, and K(z) spread by K(a) is
// K(z + a), since K is the Poisson kernel of the half-space: its transform is exp(-z sqrt(k^2 + sigma^2)). So light is spread by
// 2 exp(sigma a) K(a) - exp(2 sigma a) K(2 a), of integral 1, in which what K(a) would bring far away cancels: what comes out in
// all is as much as of a point, and far from the surfel it is the point's. It is below 0 by a little where light has fallen off.
//
// A source far below surfels spreads by itself, and needs a = 0. A surfel much larger than that depth needs one of its own size:
// a = sqrt(z^2 + (2 r)^2) - z, and so much more as it is larger than light goes, 1 / sigma.

// The irradiance that epsilon is a share of.
override UNIT: f32 = 1.0;
// Transmittance of the boundary times the albedo of an extinction, what light falls off by, and depths of the two sources.
override GAIN_RED: f32 = 0.0;
override GAIN_GREEN: f32 = 0.0;
override GAIN_BLUE: f32 = 0.0;
override SIGMA_TR_RED: f32 = 0.0;
override SIGMA_TR_GREEN: f32 = 0.0;
override SIGMA_TR_BLUE: f32 = 0.0;
override Z_R_RED: f32 = 1.0;
override Z_R_GREEN: f32 = 1.0;
override Z_R_BLUE: f32 = 1.0;
override Z_V_RED: f32 = 1.0;
override Z_V_GREEN: f32 = 1.0;
override Z_V_BLUE: f32 = 1.0;

// pi times the largest that z distance^2 / rho^3 is, 2 / 27^0.5 at distance^2 = 2 z^2, over 2.
const STEEPEST: f32 = 0.60459979;
// Larger surfels count as this, which keeps squares of lengths in range.
const WIDEST: f32 = 1e12;
// Where light goes less far than this share of a surfel's radius it is taken to go so far: no picture shows the difference.
const SHORTEST: f32 = 1e-3;

// Below epsilon from here on, as far as the spread above lets one say.
fn max_distance(sender: Sender, epsilon: f32) -> f32 {
  let brightest = max_component(vec3f(GAIN_RED, GAIN_GREEN, GAIN_BLUE) * sender.front);
  let share = STEEPEST * (brightest / UNIT) / epsilon;
  return select(-1.0, sender.radius * sqrt(clamp(share, 0.0, 1e24)), brightest > 0.0);
}

// 2 pi radius^2 exp(sigma a) K(z + a), with exponents that do not cancel.
fn deeper(z: vec3f, a: vec3f, sigma: vec3f, radius: f32, distance2: f32) -> vec3f {
  let depth = z + a;
  let rho = sqrt(distance2 + depth * depth);
  let share = radius / rho;
  let decay = exp(-sigma * ((distance2 + z * (z + 2.0 * a)) / (rho + a)));
  return (depth / rho) * (1.0 + sigma * rho) * decay * share * share;
}

// The same of a source at depth z whose light is spread.
fn spread(z: vec3f, sigma: vec3f, radius: f32, distance2: f32) -> vec3f {
  let width = 2.0 * radius;
  let a = (1.0 + sigma * radius) * width * (width / (z + sqrt(z * z + width * width)));
  return 2.0 * deeper(z, a, sigma, radius, distance2) - deeper(z, 2.0 * a, sigma, radius, distance2);
}

fn contribution(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32) -> vec3f {
  let radius = min(sender.radius, WIDEST);
  let sigma_tr = vec3f(SIGMA_TR_RED, SIGMA_TR_GREEN, SIGMA_TR_BLUE);
  let longer = max(SHORTEST * radius * sigma_tr, vec3f(1.0));
  let sigma = sigma_tr / longer;
  let z_r = longer * vec3f(Z_R_RED, Z_R_GREEN, Z_R_BLUE);
  let z_v = longer * vec3f(Z_V_RED, Z_V_GREEN, Z_V_BLUE);
  let sources = spread(z_r, sigma, radius, distance2) + spread(z_v, sigma, radius, distance2);
  // pi r^2 of the surfel's area over 4 pi of the profile.
  return 0.25 * vec3f(GAIN_RED, GAIN_GREEN, GAIN_BLUE) * sender.front * sources;
}

fn resolve(sum: vec3f, albedo: vec3f) -> vec4f {
  return vec4f(albedo * max(sum, vec3f(0.0)), 1.0);
}
