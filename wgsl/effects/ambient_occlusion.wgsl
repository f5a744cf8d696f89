// Ambient occlusion by point-to-disk form factors (Wallace et al. 1989; Deep Screen Space 4): the share of the
// cosine-weighted hemisphere that a disk covers. Disks add up, since none knows of the others.

override TWO_SIDED: bool = false;
// 0: visibility is one minus the sum. 1: it is exp(-sum), as if occluders lay independently of each other.
override OVERLAP: u32 = 0u;

// F = r^2 / (d^2 + r^2) at most, so F < epsilon from here on.
fn max_distance(sender: Sender, epsilon: f32) -> f32 {
  return sender.radius * sqrt(max(1.0 / epsilon - 1.0, 0.0));
}

fn contribution(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32) -> f32 {
  let receiver_side = max(dot(receiver_normal, to_sender), 0.0);
  let facing = -dot(sender.normal, to_sender);
  let sender_side = select(max(facing, 0.0), abs(facing), TWO_SIDED);
  // cos cos' r^2 / (d^2 + r^2), arranged so that no radius overflows its square.
  let ratio = distance2 / max(sender.radius, 1e-18);
  return receiver_side * sender_side / (max(distance2, 1e-30) * (1.0 + ratio / max(sender.radius, 1e-18)));
}

// The directions below the pixel's own surface: all of the hemisphere about its shading normal that the plane cuts off.
fn own_surface(cosine: f32) -> f32 {
  return select(0.5 - 0.5 * cosine, -log(0.5 + 0.5 * cosine), OVERLAP == 1u);
}

fn resolve(sum: f32, albedo: vec3f) -> vec4f {
  let visibility = select(1.0 - sum, exp(-sum), OVERLAP == 1u);
  return vec4f(vec3f(clamp(visibility, 0.0, 1.0)), 1.0);
}
