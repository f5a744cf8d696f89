// Bent normals: the mean of the directions that nothing hides, cosine-weighted (Landis, Production-Ready Global Illumination,
// 2002). Of an open hemisphere it is two thirds of the normal; what each disk covers is taken off, the form factor times the
// direction, as is from visibility the form factor (wgsl/effects/ambient_occlusion.wgsl). Disks do not hide each other.

#import form_factor

override TWO_SIDED: bool = false;
// 0: what is hidden is the sum, up to all. 1: it is 1 - exp(-sum), as if occluders lay independently of each other.
override OVERLAP: u32 = 0u;

fn max_distance(sender: Sender, epsilon: f32) -> f32 {
  return form_factor_distance(sender.radius, epsilon);
}

fn contribution(
  sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32, receiver: Receiver,
) -> vec4f {
  let factor = form_factor(sender, receiver_normal, to_sender, distance2);
  let hidden = select(max(factor, 0.0), abs(factor), TWO_SIDED);
  return hidden * vec4f(direction_to(to_sender, distance2), 1.0);
}

// The unit bent normal, and visibility. No direction below the horizon is open, whatever sums say.
fn resolve(sum: vec4f, albedo: vec3f, receiver: Receiver) -> vec4f {
  let hidden = select(min(sum.w, 1.0), 1.0 - exp(-sum.w), OVERLAP == 1u);
  let open = receiver.normal * (2.0 / 3.0) - sum.xyz * (hidden / max(sum.w, 1e-30));
  let above = open - receiver.normal * min(dot(open, receiver.normal), 0.0);
  return vec4f(normalize_or(above, receiver.normal), 1.0 - hidden);
}
