// What a pixel sees of a surfel's disk, for effects (wgsl/effects). Needs math.

// The share of the cosine-weighted hemisphere that the disk covers (Wallace et al. 1989), cos cos' r^2 / (d^2 + r^2); negative
// where the pixel is behind it. Arranged so that no radius overflows its square.
fn form_factor(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32) -> f32 {
  let receiver_side = max(dot(receiver_normal, to_sender), 0.0);
  let facing = -dot(sender.normal, to_sender);
  let ratio = distance2 / max(sender.radius, 1e-18);
  return receiver_side * facing / (max(distance2, 1e-30) * (1.0 + ratio / max(sender.radius, 1e-18)));
}

// From here on it is below epsilon, as F = r^2 / (d^2 + r^2) at most.
fn form_factor_distance(radius: f32, epsilon: f32) -> f32 {
  return radius * sqrt(max(1.0 / epsilon - 1.0, 0.0));
}

// Unit vector to the disk's centre.
fn direction_to(to_sender: vec3f, distance2: f32) -> vec3f {
  return to_sender / sqrt(max(distance2, 1e-30));
}

// Its solid angle, up to pi at its centre; negative where the pixel is behind it. The form factor is this times the receiver's
// cosine over pi.
fn disk_solid_angle(sender: Sender, direction: vec3f, distance2: f32) -> f32 {
  let ratio = distance2 / max(sender.radius, 1e-18);
  return -PI * dot(sender.normal, direction) / (1.0 + ratio / max(sender.radius, 1e-18));
}

#if RADIANCE
// The irradiance of the disk is below epsilon units from here on. A black surfel contributes nothing anywhere.
fn radiant_distance(sender: Sender, unit: f32, epsilon: f32) -> f32 {
  let brightest = max_component(max(sender.front, sender.back));
  let share = PI * (brightest / unit) / epsilon;
  return select(-1.0, sender.radius * sqrt(clamp(share - 1.0, 0.0, 1e24)), brightest > 0.0);
}
#endif
