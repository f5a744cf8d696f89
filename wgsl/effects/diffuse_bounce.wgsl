// One bounce of diffuse light (Deep Screen Space 4): what each surfel sends times the form factor of its disk. The sum is the
// irradiance over pi. Surfels do not hide each other.

#import form_factor

// The irradiance that epsilon is a share of.
override UNIT: f32 = 1.0;

fn max_distance(sender: Sender, epsilon: f32) -> f32 {
  return radiant_distance(sender, UNIT, epsilon);
}

fn contribution(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32) -> vec3f {
  let factor = form_factor(sender, receiver_normal, to_sender, distance2);
  return abs(factor) * select(sender.back, sender.front, factor > 0.0);
}

fn resolve(sum: vec3f, albedo: vec3f) -> vec4f {
  return vec4f(albedo * sum, 1.0);
}
