// The hull drawn: a quad a segment, its light interpolated and integrated over each pixel's own hemisphere (Meder and
// Bruederlin 2018, sections 3 and 4). Fragments of pixels that belong to another segment are dropped.
//
// Moments are interpolated, not lobes: sums of light are linear, so that the total is kept, and a lobe's axis comes out
// of them with unit length.
//
// @group(0) @binding(0) params, 1 receivers, 2 the segment of each pixel, 3 segments, 4 counters, 5 vertices, 6 albedo

#import sg_hull
#import spherical_gaussian
#import sg_hull_vertex
#import screen

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var receivers: texture_2d<u32>;
@group(0) @binding(2) var<storage, read> segment_of: array<u32>;
@group(0) @binding(3) var<storage, read> segments: array<Segment>;
@group(0) @binding(4) var<storage, read> counters: Counters;
@group(0) @binding(5) var<storage, read> vertices: array<HullVertex>;
#if ALBEDO
@group(0) @binding(6) var albedo_texture: texture_2d<f32>;
#endif

struct Corner {
  @builtin(position) clip: vec4f,
  @location(0) @interpolate(flat) id: u32,
  @location(1) red: vec4f,
  @location(2) green: vec4f,
  @location(3) blue: vec4f,
  @location(4) excess: vec3f,
}

@vertex
fn corner(@builtin(vertex_index) corner: u32, @builtin(instance_index) i: u32) -> Corner {
  let slot = segment_slot(params, counters.segments, i);
  let segment = segments[slot];
  let edge = vec2u(select(segment.rect.x, segment.rect.z, (corner & 1u) != 0u),
    select(segment.rect.y, segment.rect.w, (corner & 2u) != 0u));
  let ndc = vec2f(edge) / vec2f(params.camera.viewport.zw) * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
  let vertex = vertices[i * 4u + corner];
  // Only its ratio to the other corners' counts.
  let w = select(1.0, clamp(vertex.depth / max(segment.farthest, 1e-30), 1e-6, 1.0), params.camera.perspective != 0u);
  let light = vertices[vertex.owner];
  return Corner(vec4f(ndc * w, 0.5 * w, w), slot, light.red, light.green, light.blue, light.excess);
}

fn pixel_of(fragment: vec4f) -> vec2u {
  return min(vec2u(fragment.xy) - params.camera.viewport.xy, params.camera.viewport.zw - 1u);
}

fn reflected(moments: LightMoments, excess: f32, normal: vec3f) -> f32 {
  let scaled = sg_lobe(moments);
  let irradiance = scaled.amplitude * sg_cosine_integral(dot(normal, scaled.lobe.axis), scaled.lobe.sharpness);
  return max(irradiance - excess, 0.0) / PI;
}

@fragment
fn shade(in: Corner) -> @location(0) vec4f {
  let pixel = pixel_of(in.clip);
  if segment_of[pixel.y * params.camera.viewport.z + pixel.x] != in.id {
    discard;
  }
  let normal = unpack_normal(textureLoad(receivers, pixel, 0).w);
  var color = vec3f(reflected(in.red, in.excess.x, normal), reflected(in.green, in.excess.y, normal),
    reflected(in.blue, in.excess.z, normal));
#if ALBEDO
  color *= textureLoad(albedo_texture, params.camera.viewport.xy + pixel, 0).xyz;
#endif
  return vec4f(color, 1.0);
}

// The sky reflects nothing, and no quad covers it.
@fragment
fn clear_sky(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  let pixel = pixel_of(fragment);
  if segment_of[pixel.y * params.camera.viewport.z + pixel.x] != SKY_PIXEL {
    discard;
  }
  return vec4f(0.0, 0.0, 0.0, 1.0);
}
