// What a glossy surface reflects of light that is known as sums per colour channel (src/sg_hull): the lobe of GGX as a
// spherical Gaussian about the mirrored view (Wang, Ren, Gong, Snyder and Guo 2009), times the lobe of the light.

#import math
#import packing
#import camera
#import receiver
#import hashing
#import directions
#import ggx
#import spherical_gaussian

// Of a pixel with a texel of the receivers, seen by a camera.
fn lobe_seen(camera: Camera, texel: vec4u, roughness: f32) -> Lobe {
  let relative = receiver_position(texel) - camera.eye;
  return make_lobe(unpack_normal(texel.w), to_camera(camera, relative), roughness);
}

// D about the normal has sharpness 2 / alpha^2; about the mirrored view the same facets are 4 <n, v> times the solid angle.
fn mirrored_lobe(lobe: Lobe) -> SphericalGaussian {
  let axis = lobe.frame * (lobe.view * vec3f(-1.0, -1.0, 1.0));
  return SphericalGaussian(axis, 0.5 / (lobe.alpha * lobe.alpha * lobe.view.z));
}

// The lobe with these moments of light that comes from a hemisphere about its own mean direction, of radiance that falls
// away from there: what is gathered on a surface comes from above it. A lobe over the whole sphere would be brighter in the
// middle than light that is the same all over the hemisphere. What comes from more than a hemisphere is even.
fn hemisphere_lobe(moments: LightMoments) -> Scaled {
  let mean = moments.xyz / max(moments.w, 1e-30);
  let r = min(length(mean), 1.0);
  // coth(x / 2) - 2 / x = 2 r - 1: the hemisphere's moments are those of the sphere, moved.
  let sharpness = 2.0 * sg_estimate(max(2.0 * r - 1.0, 0.0));
  let solid_angle = 0.5 * sg_integral(0.5 * sharpness) + 4.0 * PI * max(0.5 - r, 0.0);
  let lobe = SphericalGaussian(normalize_or(mean, vec3f(0.0, 0.0, 1.0)), sharpness);
  return Scaled(lobe, max(moments.w, 0.0) / solid_angle);
}

// Fresnel's factor of light about a direction, `passed` being the sharpness of the mirrored lobe over that of the product: 1
// where light is wide, 0 where it is narrow and its facet known. Seen at a grazing angle most facets of a wide lobe are
// steeper than that of its axis, and reflect less. Fitted to the mean over GGX's visible facets.
fn lobe_fresnel(lobe: Lobe, f0: f32, direction: vec3f, passed: f32) -> f32 {
  let at_axis = schlick(vec3f(f0), lobe, facet_of(lobe, direction)).x;
  let wide = lobe.alpha * passed * sqrt(passed);
  return f0 + (at_axis - f0) / (1.0 + 8.0 * wide * sqrt(wide));
}

// Radiance that one colour channel reflects. What varies slowly is taken at the axis of the product: Fresnel's factor, and
// masking and shadowing with the cosine, 0 where the axis is below the horizon.
fn glossy_channel(lobe: Lobe, mirrored: SphericalGaussian, f0: f32, moments: LightMoments) -> f32 {
  let light = hemisphere_lobe(moments);
  let product = sg_product(mirrored, light.lobe);
  let direction = product.lobe.axis * lobe.frame;
  let masked = masking(lobe) * glossy_share(lobe, direction);
  let passed = min(mirrored.sharpness / max(product.lobe.sharpness, 1e-30), 1.0);
  let fresnel = lobe_fresnel(lobe, f0, direction, passed);
  // D / (4 <n, v>) at the mirrored view is the sharpness over 2 pi.
  let share = mirrored.sharpness / (2.0 * PI) * sg_integral(product.lobe.sharpness);
  return light.amplitude * product.amplitude * share * masked * fresnel;
}

fn glossy_radiance(lobe: Lobe, f0: vec3f, red: LightMoments, green: LightMoments, blue: LightMoments) -> vec3f {
  let mirrored = mirrored_lobe(lobe);
  return vec3f(glossy_channel(lobe, mirrored, f0.x, red), glossy_channel(lobe, mirrored, f0.y, green),
    glossy_channel(lobe, mirrored, f0.z, blue));
}
