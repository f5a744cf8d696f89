// ScreenSpaceGi: one bounce of light among what the image shows (Ritschel, Grosch and Seidel 2009, Approximating Dynamic
// Global Illumination in Image Space, 3). Of points in the hemisphere over a pixel those that the depth buffer has in front
// of stand for a sender each: what is seen there, with an equal share of the hemisphere as its area.

#import surface
#import hashing
#import directions
#import work

struct Params {
  camera: Camera,
  normals: vec2u,
  depth_step: f32,
  depth_relative: f32,
  // To clip space.
  project: mat4x4f,
  level: u32,
  samples: u32,
  // 1 where each pixel's points are turned by an angle of its own.
  turn: u32,
  // Of the hemisphere.
  radius: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var depth_texture: texture_2d<f32>;
@group(0) @binding(2) var normal_texture: texture_2d<f32>;
// Radiance that leaves each pixel's surface.
@group(0) @binding(3) var lit: texture_2d<f32>;
@group(0) @binding(4) var result: texture_storage_2d<rgba16float, write>;
#if LIST
@group(0) @binding(5) var<storage, read> work: array<u32>;
#endif

// The largest that a half holds.
const BRIGHTEST: f32 = 65504.0;

// A point of the unit ball's upper half, by equal volumes: directions by equal solid angles, and the cubes of the lengths of
// directions that lie together spread evenly.
fn ball_point(i: u32, turn: f32) -> vec3f {
  let height = (f32(i) + 0.5) / f32(params.samples);
  let angle = 2.0 * PI * unit_float(reverseBits(i)) + turn;
  // Wrapped in integers: a large float has no fraction left.
  let spread = unit_float(i * 0x9e3779b9u + 0x80000000u);
  return pow(spread, 1.0 / 3.0) * vec3f(sqrt(max(1.0 - height * height, 0.0)) * vec2f(cos(angle), sin(angle)), height);
}

// What of the radiance that a sample finds arrives, in units of irradiance / pi.
fn arriving(p: Surface, at: vec3f, area: f32) -> vec3f {
  let clip = params.project * vec4f(at, 1.0);
  let uv = clip.xy / clip.w * vec2f(0.5, -0.5) + 0.5;
  if !(clip.w > 0.0 && all(uv >= vec2f(0.0)) && all(uv < vec2f(1.0))) {
    return vec3f(0.0);
  }
  let size = params.camera.viewport.zw;
  let pixel = min(vec2u(uv * vec2f(size)), size - 1u);
  let texel = params.camera.viewport.xy + pixel;
  let seen = unproject(params.camera, pixel, textureLoad(depth_texture, texel, 0).x);
  if seen.w == 0.0 {
    return vec3f(0.0);
  }
  let q = seen.xyz;
  // Nothing is in front of the sample, and what is seen is behind it.
  if dot(at - q, to_camera(params.camera, q - params.camera.eye)) >= 0.0 {
    return vec3f(0.0);
  }
  let offset = q - p.position;
  let distance2 = dot(offset, offset);
  if distance2 > params.radius * params.radius {
    return vec3f(0.0);
  }
  let direction = normalize_or(offset, vec3f(0.0));
  let normal = decode_normal(params.camera, params.normals, textureLoad(normal_texture, texel, 0).xyz, vec3f(0.0));
  let cosines = max(dot(p.normal, direction), 0.0) * max(-dot(normal, direction), 0.0);
  let radiance = textureLoad(lit, texel, 0).xyz;
  if cosines == 0.0 || !is_finite3(radiance) {
    return vec3f(0.0);
  }
  return clamp(radiance, vec3f(0.0), vec3f(BRIGHTEST)) * (cosines * area / (PI * distance2 + area));
}

fn gather(pixel: vec2u) -> vec3f {
  let p = surface_at(pixel);
  if p.sky {
    return vec3f(0.0);
  }
  let frame = tangent_frame(p.normal);
  let noise = 2.0 * PI * unit_float(hash2(pixel.x, pixel.y));
  let turn = select(0.0, noise, params.turn != 0u);
  let area = 2.0 * PI * params.radius * params.radius / f32(params.samples);
  var sum = vec3f(0.0);
  for (var i = 0u; i < params.samples; i++) {
    sum += arriving(p, p.position + frame * (params.radius * ball_point(i, turn)), area);
  }
  return min(sum, vec3f(BRIGHTEST));
}

@compute @workgroup_size(8, 8)
fn bounce(
  @builtin(workgroup_id) group: vec3u,
  @builtin(num_workgroups) groups: vec3u,
  @builtin(local_invocation_index) index: u32,
) {
  let item = work_item(group, groups, index);
  if item.valid {
    textureStore(result, item.texel, vec4f(gather(item.pixel), 1.0));
  }
}
