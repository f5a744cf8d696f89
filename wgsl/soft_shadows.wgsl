// SoftShadows: the share of a light with an extent that arrives at a pixel, percentage-closer (Fernando 2005, Percentage-
// Closer Soft Shadows): what blocks the light is looked for around the pixel in the light's shadow map; how far from the
// pixel it is on average gives the penumbra's width, and over as much of the map the light's visibility is averaged.
//
//   soften  of a light with an extent
//   harden  of one without: a look-up a pixel
//
// All points that are looked up lie in the pixel's tangent plane, where a ray from the light meets it: a plane does not
// shadow itself, however wide the penumbra.

#import surface
#import hashing
#import light
#import directions
#import shadow_map
#import work

struct Params {
  camera: Camera,
  normals: vec2u,
  depth_step: f32,
  depth_relative: f32,
  light: Light,
  level: u32,
  // Points that are looked up for blockers, and for visibility.
  blockers: u32,
  samples: u32,
  // 1 where each pixel's points are turned by an angle of its own.
  turn: u32,
  // The light's radius, or the tangent of its angular radius for a directional one.
  extent: f32,
  // The widest half width of a penumbra.
  max_penumbra: f32,
  padding0: u32,
  padding1: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var depth_texture: texture_2d<f32>;
@group(0) @binding(2) var normal_texture: texture_2d<f32>;
@group(0) @binding(3) var<uniform> shadow: Shadow;
@group(0) @binding(4) var depth_map: texture_2d_array<f32>;
@group(0) @binding(5) var result: texture_storage_2d<r32float, write>;
#if LIST
@group(0) @binding(6) var<storage, read> work: array<u32>;
#endif

// Seen at a lower angle than this slope, points slide along the tangent plane no farther.
const STEEPEST: f32 = 16.0;
const GOLDEN_ANGLE: f32 = 2.399963229728653;

// A pixel's surface and the light.
struct Receiver {
  point: vec3f,
  normal: vec3f,
  arrival: Arrival,
  // Where points are moved before they are looked up: off the surface, and as far to the light. What lies nearer than a
  // texel of the map is then no blocker; at inner edges, texels of the other surface would be some, here and there.
  side: vec3f,
  // Its third axis points to the light.
  frame: mat3x3f,
  turn: f32,
}

// Of a surface that faces the light.
fn receiver_of(pixel: vec2u, surface: Surface, arrival: Arrival) -> Receiver {
  let noise = 2.0 * PI * unit_float(hash2(pixel.x, pixel.y));
  let turn = select(0.0, noise, params.turn != 0u);
  let side = surface.normal + arrival.to_light;
  return Receiver(surface.position, surface.normal, arrival, side, tangent_frame(arrival.to_light), turn);
}

// Points of a spiral in the unit disk: with the exponent 0.5 they cover it evenly (Vogel 1979), with 1 they are denser
// towards the middle.
fn spiral(i: u32, count: u32, exponent: f32, turn: f32) -> vec2f {
  let angle = f32(i) * GOLDEN_ANGLE + turn;
  return pow((f32(i) + 0.5) / f32(count), exponent) * vec2f(cos(angle), sin(angle));
}

// The point of the tangent plane that the light's middle sees at an offset across its ray to the pixel.
fn beside(r: Receiver, offset: vec2f) -> vec3f {
  let across = r.frame * vec3f(offset, 0.0);
  var along = -r.arrival.to_light;
  if params.light.kind != DIRECTIONAL {
    along = normalize_or(along + across / r.arrival.distance, along);
  }
  // The offset is square to the ray: the plane falls off by less than it has slope.
  let steepness = dot(r.normal, across) / min(dot(r.normal, along), -1e-6);
  let most = STEEPEST * length(offset);
  return r.point + across - clamp(steepness, -most, most) * along;
}

// How far a blocker is from the surface along the light's ray, and 0 where there is none.
fn gap(r: Receiver, found: LookUp) -> f32 {
  if !is_hidden(found) {
    return 0.0;
  }
  let camera = shadow.cameras[found.layer];
  if camera.perspective == 0u {
    return max(camera.depth_scale * (found.depth - found.nearest), 0.0);
  }
  // Distances along the axis relate as those along the ray. Of two depths d = scale / distance + constant of one ray.
  let own = found.w * camera.per_w;
  let apart = (found.nearest - found.depth) * own;
  let share = clamp(apart / (camera.depth_scale + apart), 0.0, 1.0);
  return share * select(own, r.arrival.distance, params.light.kind != DIRECTIONAL);
}

// Half width of the penumbra that a blocker makes.
fn penumbra(r: Receiver, gap: f32) -> f32 {
  if params.light.kind == DIRECTIONAL {
    return min(params.extent * gap, params.max_penumbra);
  }
  return min(params.extent * gap / max(r.arrival.distance - gap, 1e-6 * r.arrival.distance), params.max_penumbra);
}

// Side of a texel of the map where a point is.
fn texel_side(point: vec3f) -> f32 {
  let own = first_map(point);
  if own.layer == shadow.count {
    return 0.0;
  }
  return shadow.cameras[own.layer].texel * own.clip.w;
}

// How wide a pixel's penumbra is, half of it; 0 where nothing blocks the light.
fn width_at(r: Receiver) -> f32 {
  let middle = look_up(r.point, r.side);
  var total = gap(r, middle);
  var count = select(0.0, 1.0, is_hidden(middle));
  for (var i = 0u; i < params.blockers; i++) {
    // Most penumbrae are far narrower than the widest.
    let offset = params.max_penumbra * spiral(i, params.blockers, 1.0, r.turn);
    let found = gap(r, look_up(beside(r, offset), r.side));
    // Only what lies between the surface and some of the light.
    if found > 0.0 && length(offset) <= penumbra(r, found) {
      total += found;
      count += 1.0;
    }
  }
  // What is narrower than a texel is the map's own edge.
  let width = max(penumbra(r, total / max(count, 1.0)), texel_side(r.point));
  return select(0.0, width, count > 0.0);
}

// Of the pixels of a workgroup those where something blocks the light: their number, x | y << 16, half widths of their
// penumbrae, and how many samples are lit.
var<workgroup> blocked: atomic<u32>;
var<workgroup> pixels: array<u32, 64>;
var<workgroup> widths: array<f32, 64>;
var<workgroup> lit: array<atomic<u32>, 64>;

// Of the samples from `first` on, in steps, how many are lit.
fn lit_of(r: Receiver, width: f32, first: u32, step: u32) -> u32 {
  var visible = 0u;
  for (var i = first; i < params.samples; i += step) {
    let offset = width * spiral(i, params.samples, 0.5, r.turn);
    visible += select(1u, 0u, is_hidden(look_up(beside(r, offset), r.side)));
  }
  return visible;
}

@compute @workgroup_size(8, 8)
fn soften(
  @builtin(workgroup_id) group: vec3u,
  @builtin(num_workgroups) groups: vec3u,
  @builtin(local_invocation_index) index: u32,
) {
  if index == 0u {
    atomicStore(&blocked, 0u);
  }
  atomicStore(&lit[index], 0u);
  workgroupBarrier();

  let item = work_item(group, groups, index);
  var value = 1.0;
  var slot = 64u;
  if item.valid {
    let surface = surface_at(item.pixel);
    let arrival = light_at(params.light, surface.position);
    // A surface that faces away shadows itself.
    let faces = dot(surface.normal, arrival.to_light) > 0.0;
    value = select(0.0, 1.0, surface.sky || faces);
    if faces && !surface.sky {
      let width = width_at(receiver_of(item.pixel, surface, arrival));
      if width > 0.0 {
        slot = atomicAdd(&blocked, 1u);
        pixels[slot] = item.pixel.x | (item.pixel.y << 16u);
        widths[slot] = width;
      }
    }
  }
  workgroupBarrier();

  // Wherever nothing blocks the light there is nothing to average: all invocations share the samples of the others.
  let count = atomicLoad(&blocked);
  let shares = 64u / max(count, 1u);
  let own = index % max(count, 1u);
  let share = index / max(count, 1u);
  if count > 0u && share < shares {
    let pixel = vec2u(pixels[own] & 0xffffu, pixels[own] >> 16u);
    let surface = surface_at(pixel);
    let r = receiver_of(pixel, surface, light_at(params.light, surface.position));
    atomicAdd(&lit[own], lit_of(r, widths[own], share, shares));
  }
  workgroupBarrier();

  if item.valid {
    if slot < 64u {
      value = f32(atomicLoad(&lit[slot])) / f32(params.samples);
    }
    textureStore(result, item.texel, vec4f(value, 0.0, 0.0, 0.0));
  }
}

// Of a light without extent.
fn hard_at(pixel: vec2u) -> f32 {
  let surface = surface_at(pixel);
  if surface.sky {
    return 1.0;
  }
  let arrival = light_at(params.light, surface.position);
  // A surface that faces away shadows itself.
  let faces = dot(surface.normal, arrival.to_light) > 0.0;
  return select(0.0, 1.0, faces && !is_hidden(look_up(surface.position, surface.normal + arrival.to_light)));
}

@compute @workgroup_size(8, 8)
fn harden(
  @builtin(workgroup_id) group: vec3u,
  @builtin(num_workgroups) groups: vec3u,
  @builtin(local_invocation_index) index: u32,
) {
  let item = work_item(group, groups, index);
  if item.valid {
    textureStore(result, item.texel, vec4f(hard_at(item.pixel), 0.0, 0.0, 0.0));
  }
}
