// One bounce of indirect light from the depth buffer: along each of some cosine-weighted directions a march through the
// image, to the first pixel that the ray passes behind by less than the surfaces' thickness. What that pixel sends out
// is what comes in, so that the mean over directions is irradiance / pi; what meets nothing brings nothing.
//
// Screen-space marches in perspective after McGuire and Mara, Efficient GPU Screen-Space Ray Tracing (2014).

@group(0) @binding(1) var depths: texture_2d<f32>;
@group(0) @binding(2) var normals: texture_2d<f32>;
// Radiance that leaves each pixel's surface.
@group(0) @binding(3) var lit: texture_2d<f32>;
@group(0) @binding(4) var result: texture_storage_2d<rgba32float, write>;

// Between the last step in front of a surface and the first behind it.
const BISECTIONS: u32 = 4u;
// Sine of the elevation that a hit has over the tangent plane: what is lower is the pixel's own surface.
const LOWEST: f32 = 0.02;

struct March {
  start: vec2f,
  line: vec2f,
  // One over the depth is linear along the image: at the start, and its growth a pixel.
  start_inverse: f32,
  growth: f32,
}

fn ray_depth(march: March, offset: f32) -> f32 {
  return 1.0 / max(march.start_inverse + march.growth * offset, 1e-30);
}

fn texel_at(march: March, offset: f32) -> vec2i {
  return clamp(vec2i(march.start + offset * march.line), vec2i(0), size() - 1);
}

// How far behind the pixel's surface the ray is.
fn behind(march: March, offset: f32) -> f32 {
  return ray_depth(march, offset) - textureLoad(depths, texel_at(march, offset), 0).x;
}

fn incoming(origin: vec3f, normal: vec3f, direction: vec3f, start: vec2f, jitter: f32) -> vec3f {
  var march: March;
  march.start = start;
  let clip = params.clip_from_eye * vec4f(origin, 1.0);
  let ahead = params.clip_from_eye * vec4f(direction, 0.0);
  // To the radius, or shortly before the eye's plane, or as good as infinitely far.
  var end = min(params.radius, 1000.0 * clip.w);
  if ahead.w < 0.0 {
    end = min(end, -0.98 * clip.w / ahead.w);
  }
  let end_clip = clip + end * ahead;
  let extent = pixel_of_clip(end_clip) - start;
  let pixels = length(extent);
  if pixels < 1.0 {
    return vec3f(0.0);
  }
  march.line = extent / pixels;
  march.start_inverse = 1.0 / clip.w;
  march.growth = (1.0 / end_clip.w - march.start_inverse) / pixels;
  let last = min(pixels, to_border(start, march.line));
  var before = 0.0;
  for (var i = 0u; i < params.steps; i++) {
    let offset = step_at(i, jitter, last);
    if offset > last {
      break;
    }
    // Coarse steps pass through a surface by more than its thickness.
    let deepest = params.thickness + abs(ray_depth(march, offset) - ray_depth(march, before));
    let depth = behind(march, offset);
    if depth > 0.0 && depth < deepest {
      var front = before;
      var back = offset;
      for (var k = 0u; k < BISECTIONS; k++) {
        let middle = 0.5 * (front + back);
        if behind(march, middle) > 0.0 {
          back = middle;
        } else {
          front = middle;
        }
      }
      let texel = texel_at(march, back);
      let hit = position(vec2f(texel) + 0.5, textureLoad(depths, texel, 0).x) - origin;
      if behind(march, back) < params.thickness && dot(hit, normal) > LOWEST * length(hit) {
        // The back of what is seen sends nothing this way.
        if dot(textureLoad(normals, texel, 0).xyz, direction) > 0.0 {
          return vec3f(0.0);
        }
        return textureLoad(lit, texel, 0).xyz;
      }
    }
    before = offset;
  }
  return vec3f(0.0);
}

fn radical_inverse(i: u32) -> f32 {
  return f32(reverseBits(i) >> 8u) / 16777216.0;
}

fn gather(texel: vec2i, depth: f32) -> vec3f {
  let at = vec2f(texel) + 0.5;
  let p = position(at, depth);
  let normal = normalize(textureLoad(normals, texel, 0).xyz);
  let tangent = normalize(cross(normal, select(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), abs(normal.x) > 0.7)));
  let bitangent = cross(normal, tangent);
  let noise = pixel_noise(texel);
  var sum = vec3f(0.0);
  for (var i = 0u; i < params.count; i++) {
    // Hammersley's points, shifted: uniform on the disk under the hemisphere.
    let u = fract(radical_inverse(i) + noise.x);
    let phi = 2.0 * PI * (f32(i) + noise.y) / f32(params.count);
    let disk = sqrt(u) * vec2f(cos(phi), sin(phi));
    let direction = disk.x * tangent + disk.y * bitangent + sqrt(1.0 - u) * normal;
    let jitter = fract(noise.x + noise.y + f32(i) * 0.6180339887);
    sum += incoming(p, normal, direction, at, jitter);
  }
  return sum / f32(params.count);
}

@compute @workgroup_size(8, 8)
fn ssgi(@builtin(global_invocation_id) id: vec3u) {
  if any(id.xy >= params.size) {
    return;
  }
  let depth = textureLoad(depths, id.xy, 0).x;
  var value = vec3f(0.0);
  if !is_sky(depth) {
    value = gather(vec2i(id.xy), depth);
  }
  textureStore(result, id.xy, vec4f(value, 0.0));
}
