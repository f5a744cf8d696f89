// One bounce of light off glossy surfaces: what each surfel sends, times its solid angle, the lobe of GGX in its direction
// (wgsl/common/ggx.wgsl) and the cosine. Surfels do not hide each other.
//
// A disk that is as wide as the lobe or wider is not seen at its middle alone: the lobe is widened by the spread of the facets
// that mirror the view into the disk. On coarse levels a disk is as large as all that it stands for, so that the few that a
// pixel sees there make no sparks.

#import form_factor
#import ggx

// The irradiance that epsilon is a share of.
override UNIT: f32 = 1.0;
// Reflectance seen straight on.
override F0_RED: f32 = 0.04;
override F0_GREEN: f32 = 0.04;
override F0_BLUE: f32 = 0.04;

fn max_distance(sender: Sender, epsilon: f32) -> f32 {
  return radiant_distance(sender, UNIT, epsilon);
}

// A lobe as a disk of this solid angle sees it. Facets are spread over solid_angle / (4 <v, h>), evenly: a variance of that over
// 4 pi along each axis, half of which is what alpha^2 is of a normal distribution.
fn widened(lobe: Lobe, facet: vec3f, solid_angle: f32) -> Lobe {
  let spread = solid_angle / (8.0 * PI * max(dot(lobe.view, facet), 1e-4));
  var wide = lobe;
  wide.alpha = min(sqrt(lobe.alpha * lobe.alpha + spread), 1.0);
  return wide;
}

fn contribution(
  sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32, receiver: Receiver,
) -> vec3f {
  let direction = direction_to(to_sender, distance2);
  let solid_angle = disk_solid_angle(sender, direction, distance2);
  let lobe = make_lobe(receiver_normal, receiver.to_eye, receiver.roughness);
  let light = direction * lobe.frame;
  let facet = facet_of(lobe, light);
  let wide = widened(lobe, facet, abs(solid_angle) * sender.share);
  let mirrored = abs(solid_angle) * glossy_pdf(wide, facet) * glossy_share(lobe, light);
  let fresnel = schlick(vec3f(F0_RED, F0_GREEN, F0_BLUE), lobe, facet);
  return mirrored * fresnel * select(sender.back, sender.front, solid_angle > 0.0);
}

fn resolve(sum: vec3f, albedo: vec3f, receiver: Receiver) -> vec4f {
  return vec4f(sum, 1.0);
}
