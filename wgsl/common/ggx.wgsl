// Glossy lobes: microfacets of the isotropic Trowbridge-Reitz distribution (GGX), their visible normals drawn as a
// spherical cap (Dupuy and Benyoub 2023, after Heitz 2018), masked and shadowed with correlated heights (Smith; Heitz
// 2014). Directions are in the normal's frame, z along it, and point away from the surface.

#import math
#import directions
#import roughness

// Below this the density's error shows: half vectors are known to some 3e-7, and D changes by 2 / alpha times that.
const MIN_ALPHA: f32 = 1e-3;
// A view from the horizon or below counts as from this far above it, which is what a packed normal is known to.
const MIN_COSINE: f32 = 1e-4;
// How much denser than its neighbour a pixel may ask for a direction.
const MAX_RATIO: f32 = 4.0;

struct Lobe {
  // The frame's axes in the world.
  frame: mat3x3f,
  // Unit vector to the eye, at least MIN_COSINE above the horizon.
  view: vec3f,
  // Width of the distribution, bounded below.
  alpha: f32,
  // The same without bound.
  width: f32,
}

// A direction, and the microfacet normal that mirrors the view into it.
struct GlossyDirection {
  light: vec3f,
  facet: vec3f,
}

// About a unit normal, of a perceptual roughness.
fn make_lobe(normal: vec3f, to_eye: vec3f, roughness: f32) -> Lobe {
  let frame = tangent_frame(normal);
  let v = to_eye * frame;
  let view = normalize_or(vec3f(v.xy, max(v.z, MIN_COSINE)), vec3f(0.0, 0.0, 1.0));
  let clean = clean_roughness(roughness);
  let width = clean * clean;
  return Lobe(frame, view, max(width, MIN_ALPHA), width);
}

// A point of the unit square to a direction. It may point below the horizon, where nothing arrives.
fn glossy_direction(lobe: Lobe, point: vec2f) -> GlossyDirection {
  // Stretched by 1 / alpha the facets are a hemisphere, and its reflections of the view fill a cap evenly.
  let v = normalize(vec3f(lobe.alpha * lobe.view.xy, lobe.view.z));
  let disk = concentric_disk(point);
  let r2 = disk.z;
  let c = 1.0 + v.z;
  let h = vec3f(disk.xy * sqrt(max(c * (2.0 - r2 * c), 0.0)) + v.xy, c * (1.0 - r2));
  let facet = normalize_or(vec3f(lobe.alpha * h.xy, h.z), vec3f(0.0, 0.0, 1.0));
  return GlossyDirection(2.0 * dot(lobe.view, facet) * facet - lobe.view, facet);
}

// The facet that mirrors a lobe's view into a direction.
fn facet_of(lobe: Lobe, light: vec3f) -> vec3f {
  return normalize_or(lobe.view + light, vec3f(0.0, 0.0, -1.0));
}

// Density over solid angle with which a direction is drawn, from its facet: D G1 / (4 <n, v>), in which <n, v> cancels.
fn glossy_pdf(lobe: Lobe, facet: vec3f) -> f32 {
  if facet.z <= 0.0 {
    return 0.0;
  }
  let alpha2 = lobe.alpha * lobe.alpha;
  // In this form nothing cancels where the facet is near the normal.
  let q = facet.z * facet.z + dot(facet.xy, facet.xy) / alpha2;
  let d = 1.0 / (PI * alpha2 * q * q);
  return 0.5 * d / (lobe.view.z + stretched(lobe.alpha, lobe.view));
}

// The length of a unit vector whose part in the plane is scaled by alpha.
fn stretched(alpha: f32, v: vec3f) -> f32 {
  return sqrt(alpha * alpha * dot(v.xy, v.xy) + v.z * v.z);
}

// The share of the facets towards the view that it sees: G1.
fn masking(lobe: Lobe) -> f32 {
  return 2.0 * lobe.view.z / (lobe.view.z + stretched(lobe.alpha, lobe.view));
}

// The BRDF times the cosine over the density of a direction, without Fresnel's factor: G2 / G1, 0...1, and 0 below the
// horizon.
fn glossy_share(lobe: Lobe, light: vec3f) -> f32 {
  if light.z <= 0.0 {
    return 0.0;
  }
  let v = stretched(lobe.alpha, lobe.view);
  let l = stretched(lobe.alpha, light);
  return min(light.z * (lobe.view.z + v) / (light.z * v + lobe.view.z * l), 1.0);
}

// Fresnel's factor (Schlick 1994) of a facet, without the reflectance straight on: how much of the way it is from that to 1.
fn schlick_power(lobe: Lobe, facet: vec3f) -> f32 {
  let m = clamp(1.0 - dot(lobe.view, facet), 0.0, 1.0);
  let m2 = m * m;
  return m2 * m2 * m;
}

// The factor itself, of the reflectance straight on and a facet.
fn schlick(f0: vec3f, lobe: Lobe, facet: vec3f) -> vec3f {
  return f0 + (1.0 - f0) * schlick_power(lobe, facet);
}

// About what share of even light a surface of a roughness sends to an eye at a cosine to its normal: of what counts as much as
// the reflectance straight on, and of what is mirrored besides. Fitted to the lobe's own sum, within a factor of 1.45 of it.
fn even_shares(cosine: f32, roughness: f32) -> vec2f {
  let m = 1.0 - cosine;
  let m2 = m * m;
  let besides = m2 * m2 * m * exp2(-4.6 * pow(roughness, 1.4));
  // Facets hide each other, of rough surfaces most where they are seen straight on.
  let whole = 1.0 - 0.7 * pow(roughness, 2.5) * sqrt(cosine);
  return vec2f(whole - besides, besides);
}

// How much two pixels' lobes overlap, 0...1: the Bhattacharyya coefficient of normal distributions about their mirrored
// directions, with GGX's width in slopes, doubled by the reflection. `parallax` is the angle between the two pixels: what is
// mirrored is taken to be as far away as they are, so that a neighbour sees it shifted by that much.
fn lobe_overlap(a: Lobe, b: Lobe, parallax: f32) -> f32 {
  let apart = a.frame * (a.view * vec3f(-1.0, -1.0, 1.0)) - b.frame * (b.view * vec3f(-1.0, -1.0, 1.0));
  let squares = max(a.width * a.width + b.width * b.width, 1e-30);
  let distance2 = dot(apart, apart) + min(parallax * parallax, 4.0);
  return 2.0 * a.width * b.width / squares * exp(-min(distance2 / (8.0 * squares), 80.0));
}
