// What a gatherer (src/sg_hull/gatherer.rs) is written against. Needs math.

#import spherical_gaussian

// Light that arrives at a point: a sum of samples per colour channel, and what a surface with the normal that it was
// gathered for receives of them.
struct Lobes {
  red: LightMoments,
  green: LightMoments,
  blue: LightMoments,
  irradiance: vec3f,
}

// How far below the horizon light still counts for the lobes, as a sine: pixels whose normals lean that way receive it.
const BELOW_HORIZON: f32 = 0.5;

// Adds light from a direction (a unit vector) to what is gathered for a normal; `irradiance` is that of a surface that
// faces it.
fn add_light(lobes: Lobes, normal: vec3f, direction: vec3f, irradiance: vec3f) -> Lobes {
  return add_moments(lobes, normal, vec4f(direction, 1.0), irradiance);
}

// Adds light of a source with extent. Of `moments` xyz is the integral of the direction over the solid angle that the
// source covers, w the solid angle.
fn add_moments(lobes: Lobes, normal: vec3f, moments: vec4f, radiance: vec3f) -> Lobes {
  let height = dot(normal, moments.xyz);
  let share = clamp(1.0 + height / max(BELOW_HORIZON * moments.w, 1e-30), 0.0, 1.0);
  let counted = moments * share;
  return Lobes(lobes.red + counted * radiance.x, lobes.green + counted * radiance.y, lobes.blue + counted * radiance.z,
    lobes.irradiance + radiance * max(height, 0.0));
}

// The most light that counts: what a lobe, a quad and a glossy surface make of it stays within f32.
const MOST_LIGHT: f32 = 1e18;

// Light that is not finite is none.
fn usable(moments: LightMoments) -> LightMoments {
  let good = is_finite3(moments.xyz) && is_finite(moments.w) && moments.w > 0.0;
  return select(vec4f(0.0), moments * min(1.0, MOST_LIGHT / max(moments.w, 1e-30)), good);
}

// The same of the light that a surface receives.
fn usable_irradiance(irradiance: vec3f) -> vec3f {
  return select(vec3f(0.0), clamp(irradiance, vec3f(0.0), vec3f(MOST_LIGHT)), is_finite3(irradiance));
}

fn add_lobes(a: Lobes, b: Lobes) -> Lobes {
  return Lobes(a.red + b.red, a.green + b.green, a.blue + b.blue, a.irradiance + b.irradiance);
}
