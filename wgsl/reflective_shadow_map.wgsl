// What a light's own camera sees as triangles that send light on (src/reflective_shadow_map): one per texel, with the
// texel's area on its surface and its middle. Texels without a surface, or that the light does not reach, are black.
//
// @group(0) @binding(0) params, 1 receivers, 2 albedo, 3 lights

#import math
#import packing
#import camera
#import receiver
#import albedo
#import light

struct Params {
  camera: Camera,
  light: Light,
}

struct PolygonLight {
  a: vec3f,
  red: f32,
  b: vec3f,
  green: f32,
  c: vec3f,
  blue: f32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var receivers: texture_2d<u32>;
@group(0) @binding(2) var albedo_texture: texture_2d<f32>;
@group(0) @binding(3) var<storage, read_write> lights: array<PolygonLight>;

// A texel seen more obliquely than this is as large as one that is seen so: its corners lie at infinity next.
const MIN_COSINE: f32 = 0.1;
// Of an equilateral triangle with the area of the square from -1 to 1.
const CIRCUMRADIUS: f32 = 1.7547653;

@compute @workgroup_size(8, 8)
fn texel_to_light(@builtin(global_invocation_id) id: vec3u) {
  let size = params.camera.viewport.zw;
  if any(id.xy >= size) {
    return;
  }
  var light: PolygonLight;
  let texel = textureLoad(receivers, id.xy, 0);
  if texel.w != SKY {
    let p = receiver_position(texel);
    let n = unpack_normal(texel.w);
    let relative = p - params.camera.eye;
    let toward = to_camera(params.camera, relative);
    let arrival = light_at(params.light, p);
    let irradiance = arrival.irradiance * max(dot(n, arrival.to_light), 0.0);
    let albedo = decode_albedo(textureLoad(albedo_texture, params.camera.viewport.xy + id.xy, 0).xyz);
    // Half the texel's sides across the ray, cast along the ray onto the surface.
    let half_side = 0.5 * footprint(params.camera, relative);
    let cosine = max(dot(n, toward), MIN_COSINE);
    let across = normalize_or(cross(toward, params.camera.view_to_world[1]), vec3f(1.0, 0.0, 0.0));
    let right = half_side * (across - toward * (dot(n, across) / cosine));
    let upward = cross(toward, across);
    let up = half_side * (upward - toward * (dot(n, upward) / cosine));
    let wide = 0.8660254 * CIRCUMRADIUS;
    let low = 0.5 * CIRCUMRADIUS;
    let a = p + up * CIRCUMRADIUS;
    let left_corner = p - right * wide - up * low;
    let right_corner = p + right * wide - up * low;
    let front = dot(cross(left_corner - a, right_corner - a), n) > 0.0;
    let radiosity = irradiance * albedo;
    light = PolygonLight(a, radiosity.x, select(right_corner, left_corner, front), radiosity.y,
      select(left_corner, right_corner, front), radiosity.z);
  }
  lights[id.y * size.x + id.x] = light;
}
