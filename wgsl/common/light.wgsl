// Lights (src/light.rs), in the space of the surfel cloud. Needs math.

struct Light {
  position: vec3f,
  kind: u32,
  // The unit vector along which a directional light travels, or a spot's axis.
  direction: vec3f,
  // Of a spot: 1 - cos of the outer cone's angle.
  outer: f32,
  // Irradiance at normal incidence of a directional light, intensity of the others.
  color: vec3f,
  // Of a spot: 1 / (cos inner - cos outer), 1e18 for a sharp edge.
  sharpness: f32,
}

const NO_LIGHT: u32 = 0u;
const DIRECTIONAL: u32 = 1u;
const POINT: u32 = 2u;
const SPOT: u32 = 3u;

// What stands for infinity.
const FAR_LIGHT: f32 = 1e18;
// Nearer than this counts as this far: the irradiance of a light without extent has no bound.
const MIN_LIGHT_DISTANCE: f32 = 1e-9;
// Nearer than this a point is at the light and has no direction to it.
const AT_LIGHT: f32 = 1e-18;

// A light seen from a point.
struct Arrival {
  // Unit vector; zero where the point is at the light.
  to_light: vec3f,
  distance: f32,
  // Of a surface that faces the light.
  irradiance: vec3f,
}

// The way from a point to a light.
struct Way {
  // Unit vector; zero where the point is at the light.
  to_light: vec3f,
  distance: f32,
}

fn way_to(light: Light, point: vec3f) -> Way {
  if light.kind == DIRECTIONAL {
    return Way(-light.direction, FAR_LIGHT);
  }
  let offset = light.position - point;
  // Scaled first: squares of lengths leave the range of f32.
  let scale = max_component(abs(offset));
  if scale < AT_LIGHT {
    return Way(vec3f(0.0), 0.0);
  }
  let scaled = offset / scale;
  let stretch = length(scaled);
  return Way(scaled / stretch, scale * stretch);
}

// What a light sends to a point, whatever stands between.
fn light_at(light: Light, point: vec3f) -> Arrival {
  let way = way_to(light, point);
  let to_light = way.to_light;
  let distance = way.distance;
  if light.kind == DIRECTIONAL {
    return Arrival(to_light, distance, light.color);
  }
  if distance == 0.0 {
    return Arrival(to_light, distance, vec3f(0.0));
  }
  let inverse = 1.0 / max(distance, MIN_LIGHT_DISTANCE);
  var irradiance = min(light.color * inverse * inverse, vec3f(FAR_LIGHT));
  if light.kind == SPOT {
    // 1 - cos by the chord: the cosine of a narrow cone has lost its digits.
    let chord = light.direction + to_light;
    let t = clamp((light.outer - 0.5 * dot(chord, chord)) * light.sharpness, 0.0, 1.0);
    irradiance *= t * t * (3.0 - 2.0 * t);
  }
  return Arrival(to_light, distance, irradiance);
}
