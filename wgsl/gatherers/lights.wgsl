// Lights without extent (src/light.rs), without shadows.

#import light

@group(1) @binding(0) var<storage, read> gathered_lights: array<Light>;

fn gather(position: vec3f, normal: vec3f, lane: u32, lanes: u32) -> Lobes {
  var lobes: Lobes;
  let count = arrayLength(&gathered_lights);
  for (var i = lane; i < count; i += lanes) {
    let arrival = light_at(gathered_lights[i], position);
    lobes = add_light(lobes, normal, arrival.to_light, arrival.irradiance);
  }
  return lobes;
}
