// Light gathered at every pixel for comparison, and at the pixels of quads that do not fit (src/sg_hull).
//
// @group(0) @binding(0) params, 1 receivers, 2 counters, 3 and 4 the list of pixels, 6 albedo, 7 roughness
// @group(1) what the gatherer binds

#import sg_hull
#import dispatch
#import lobes
#import gatherer
#import screen
#import target
#if GLOSSY
#import sg_glossy
#endif

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var receivers: texture_2d<u32>;
@group(0) @binding(2) var<storage, read> counters: Counters;
// The light, with GLOSSY what is reflected of it, and the pixel's number: for the kernel and for the points.
@group(0) @binding(3) var<storage, read_write> pixels: array<vec4u>;
@group(0) @binding(4) var<storage, read> gathered: array<vec4u>;
#if ALBEDO
#import albedo
@group(0) @binding(6) var albedo_texture: texture_2d<f32>;
#endif
#if GLOSSY
@group(0) @binding(7) var roughness_texture: texture_2d<f32>;
#endif

fn reflected(pixel: vec2u, irradiance: vec3f) -> vec4f {
  var color = irradiance / PI;
#if ALBEDO
  color *= decode_albedo(textureLoad(albedo_texture, params.camera.viewport.xy + pixel, 0).xyz);
#endif
  return vec4f(color, 1.0);
}

// What a pixel keeps for its point.
#if GLOSSY
fn light_of(pixel: vec2u, texel: vec4u) -> vec3f {
  let sum = gather(receiver_position(texel), unpack_normal(texel.w), 0u, 1u);
  let roughness = textureLoad(roughness_texture, params.camera.viewport.xy + pixel, 0).x;
  let lobe = lobe_seen(params.camera, texel, roughness);
  return reflected(pixel, usable_irradiance(sum.irradiance)).xyz
    + glossy_radiance(lobe, params.f0, usable(sum.red), usable(sum.green), usable(sum.blue));
}

fn shown(pixel: vec2u, light: vec3f) -> vec4f {
  return vec4f(light, 1.0);
}
#else
fn light_of(pixel: vec2u, texel: vec4u) -> vec3f {
  return usable_irradiance(gather(receiver_position(texel), unpack_normal(texel.w), 0u, 1u).irradiance);
}

fn shown(pixel: vec2u, light: vec3f) -> vec4f {
  return reflected(pixel, light);
}
#endif

@fragment
fn per_pixel(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  let pixel = min(vec2u(fragment.xy) - params.camera.viewport.xy, params.camera.viewport.zw - 1u);
  let texel = textureLoad(receivers, pixel, 0);
  if texel.w == SKY {
    return vec4f(0.0, 0.0, 0.0, 1.0);
  }
  return held(shown(pixel, light_of(pixel, texel)));
}

fn pixel_at(number: u32) -> vec2u {
  return vec2u(number % params.camera.viewport.z, number / params.camera.viewport.z);
}

@compute @workgroup_size(64)
fn gather_pixels(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let k = linear_workgroup(workgroup) * 64u + thread;
  if k >= counters.points.x {
    return;
  }
  let number = pixels[k].w;
  let pixel = pixel_at(number);
  pixels[k] = vec4u(bitcast<vec3u>(light_of(pixel, textureLoad(receivers, pixel, 0))), number);
}

struct Point {
  @builtin(position) clip: vec4f,
  @location(0) @interpolate(flat) light: vec3f,
}

@vertex
fn point(@builtin(vertex_index) i: u32) -> Point {
  let here = gathered[i];
  let ndc = (vec2f(pixel_at(here.w)) + 0.5) / vec2f(params.camera.viewport.zw) * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
  return Point(vec4f(ndc, 0.5, 1.0), bitcast<vec3f>(here.xyz));
}

@fragment
fn draw_point(in: Point) -> @location(0) vec4f {
  let pixel = min(vec2u(in.clip.xy) - params.camera.viewport.xy, params.camera.viewport.zw - 1u);
  return held(shown(pixel, in.light));
}
