// One bounce of diffuse light (Deep Screen Space 4): what each surfel sends times the form factor of its disk. The sum is the
// irradiance over pi. Surfels do not hide each other.

// The irradiance that epsilon is a share of.
override UNIT: f32 = 1.0;

// pi F L is below epsilon from here on, as F = r^2 / (d^2 + r^2) at most. A black surfel contributes nothing anywhere.
fn max_distance(sender: Sender, epsilon: f32) -> f32 {
  let brightest = max_component(max(sender.front, sender.back));
  let share = PI * (brightest / UNIT) / epsilon;
  return select(-1.0, sender.radius * sqrt(clamp(share - 1.0, 0.0, 1e24)), brightest > 0.0);
}

fn contribution(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32) -> vec3f {
  let receiver_side = max(dot(receiver_normal, to_sender), 0.0);
  let facing = -dot(sender.normal, to_sender);
  // cos cos' r^2 / (d^2 + r^2), arranged so that no radius overflows its square.
  let ratio = distance2 / max(sender.radius, 1e-18);
  let factor = receiver_side * abs(facing) / (max(distance2, 1e-30) * (1.0 + ratio / max(sender.radius, 1e-18)));
  return factor * select(sender.back, sender.front, facing > 0.0);
}

fn resolve(sum: vec3f, albedo: vec3f) -> vec4f {
  return vec4f(albedo * sum, 1.0);
}
