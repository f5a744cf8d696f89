// Triangles that send light from their front sides (src/sg_hull/gatherer.rs), by the polygon-to-point form factor (Baum,
// Rushmeier and Winget 1989). One that is cut by the horizon counts with what it sends from above less what it would send
// from below, as long as that is more than nothing.

struct PolygonLight {
  a: vec3f,
  red: f32,
  b: vec3f,
  green: f32,
  c: vec3f,
  blue: f32,
}

@group(1) @binding(0) var<storage, read> polygon_lights: array<PolygonLight>;

// The angle between two unit vectors over its sine, from its cosine, within 5e-4 (Heitz, Hill and McGuire 2018).
fn angle_over_sine(cosine: f32) -> f32 {
  let y = abs(cosine);
  let a = 0.8543985 + (0.4965155 + 0.0145206 * y) * y;
  let b = 3.4175940 + (4.1616724 + y) * y;
  let v = 2.0 * PI * a / b;
  return select(PI * inverseSqrt(max(1.0 - cosine * cosine, 1e-7)) - v, v, cosine > 0.0);
}

fn edge(u: vec3f, v: vec3f) -> vec3f {
  return cross(u, v) * angle_over_sine(dot(u, v));
}

fn gather(position: vec3f, normal: vec3f, lane: u32, lanes: u32) -> Lobes {
  var lobes: Lobes;
  let count = arrayLength(&polygon_lights);
  for (var i = lane; i < count; i += lanes) {
    let light = polygon_lights[i];
    let a = light.a - position;
    let b = light.b - position;
    let c = light.c - position;
    // Six times the volume of the tetrahedron: its sign is the side that is seen.
    let volume = -dot(a, cross(b, c));
    let la = length(a);
    let lb = length(b);
    let lc = length(c);
    let product = la * lb * lc;
    if !(volume > 0.0 && product > 1e-30) {
      continue;
    }
    let u = a / la;
    let v = b / lb;
    let w = c / lc;
    // The integral of the direction over the solid angle, which the cosine makes the irradiance of.
    let vector = -0.5 * (edge(u, v) + edge(v, w) + edge(w, u));
    if dot(normal, vector) > -BELOW_HORIZON * length(vector) {
      let below = 1.0 + dot(u, v) + dot(v, w) + dot(w, u);
      // No less than the vector's length, which rounding and the fit above may have larger.
      let solid_angle = max(2.0 * atan2(volume / product, below), length(vector));
      let radiance = vec3f(light.red, light.green, light.blue) / PI;
      lobes = add_moments(lobes, normal, vec4f(vector, solid_angle), radiance);
    }
  }
  return lobes;
}
