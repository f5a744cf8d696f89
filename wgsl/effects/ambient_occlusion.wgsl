// Ambient occlusion by point-to-disk form factors (Wallace et al. 1989; Deep Screen Space 4): the share of the
// cosine-weighted hemisphere that a disk covers. Disks add up, since none knows of the others.

#import form_factor

override TWO_SIDED: bool = false;
// 0: visibility is one minus the sum. 1: it is exp(-sum), as if occluders lay independently of each other.
override OVERLAP: u32 = 0u;

fn max_distance(sender: Sender, epsilon: f32) -> f32 {
  return form_factor_distance(sender.radius, epsilon);
}

fn contribution(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32) -> f32 {
  let factor = form_factor(sender, receiver_normal, to_sender, distance2);
  return select(max(factor, 0.0), abs(factor), TWO_SIDED);
}

// The directions below the pixel's own surface: all of the hemisphere about its shading normal that the plane cuts off.
fn own_surface(cosine: f32) -> f32 {
  return select(0.5 - 0.5 * cosine, -log(0.5 + 0.5 * cosine), OVERLAP == 1u);
}

fn resolve(sum: f32, albedo: vec3f) -> vec4f {
  let visibility = select(1.0 - sum, exp(-sum), OVERLAP == 1u);
  return vec4f(vec3f(clamp(visibility, 0.0, 1.0)), 1.0);
}
