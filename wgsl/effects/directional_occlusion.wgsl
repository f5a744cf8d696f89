// Directional occlusion: what a white diffuse surface sends on of an environment, less what each disk hides of it: the form
// factor times the environment's mean radiance over the disk. The sum is the hidden irradiance over pi. Disks do not hide each
// other.

#import form_factor

override TWO_SIDED: bool = false;
// 0: the sum is taken off, down to nothing. 1: the share of it that is left is exp(-sum / all), as if occluders lay
// independently of each other.
override OVERLAP: u32 = 0u;

fn max_distance(sender: Sender, epsilon: f32) -> f32 {
  return form_factor_distance(sender.radius, epsilon);
}

fn contribution(
  sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32, receiver: Receiver,
) -> vec3f {
  let factor = form_factor(sender, receiver_normal, to_sender, distance2);
  let hidden = select(max(factor, 0.0), abs(factor), TWO_SIDED);
  if hidden <= 0.0 {
    return vec3f(0.0);
  }
  // On coarse levels a surfel is as large as all that it stands for.
  let direction = direction_to(to_sender, distance2);
  let solid_angle = sender.share * abs(disk_solid_angle(sender, direction, distance2));
  return hidden * environment_mean(direction, solid_angle);
}

fn resolve(sum: vec3f, albedo: vec3f, receiver: Receiver) -> vec4f {
  if all(receiver.normal == vec3f(0.0)) {
    return vec4f(0.0, 0.0, 0.0, 1.0);
  }
  let all_of_it = environment_irradiance_at(receiver.normal) / PI;
  let hidden = max(sum, vec3f(0.0));
  let independent = all_of_it * exp(-min(hidden / max(all_of_it, vec3f(1e-30)), vec3f(80.0)));
  return vec4f(select(max(all_of_it - hidden, vec3f(0.0)), independent, OVERLAP == 1u), 1.0);
}
