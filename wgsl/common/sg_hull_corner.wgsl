// Where points of a segment between its pixels lie: corners of quads and of their parts (src/sg_hull).

#needs params receivers segment_of

#import sg_hull

// Pixels across below which a segment is a sliver.
const NARROW: u32 = 4u;

struct Place {
  // Relative to the camera's eye.
  position: vec3f,
  normal: vec3f,
  // Whether it is a pixel of the segment.
  on_surface: bool,
}

fn pixel_at(number: u32) -> vec2u {
  return vec2u(number % params.camera.viewport.z, number / params.camera.viewport.z);
}

fn is_of_segment(pixel: vec2u, id: u32) -> bool {
  return segment_of[pixel.y * params.camera.viewport.z + pixel.x] == id;
}

// Where a point between pixels lies: where the ray through it meets the plane of a pixel beside it if that is the segment's
// own, and the segment's plane otherwise, within the range of its depth. The paper takes the middle of that range, which no
// plane that is seen obliquely goes through; and a pixel's own point is half a pixel off, which neighbours cannot share. Of a
// sliver, often a ledge seen edge-on, half a pixel on is elsewhere: there it is the pixel's own.
fn place_at(segment: Segment, id: u32, edge: vec2u, pixel: vec2u) -> Place {
  let own = is_of_segment(pixel, id);
  // The ray through the point, as a function of the depth along the axis.
  let ndc = vec2f(edge) / vec2f(params.camera.viewport.zw) * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
  let far_point = params.camera.unproject * vec4f(ndc, 0.0, 1.0);
  var base = vec3f(0.0);
  var direction = params.along;
  if params.camera.perspective != 0u {
    let ray = normalize_or(far_point.xyz, params.along);
    direction = ray / max(dot(ray, params.along), 1e-6);
  } else {
    let p = far_point.xyz / far_point.w;
    base = p - direction * dot(direction, p);
  }
  let texel = textureLoad(receivers, select(pixel_at(segment.anchor), pixel, own), 0);
  let normal = unpack_normal(select(segment.normal, texel.w, own));
  let narrow = min(segment.rect.z - segment.rect.x, segment.rect.w - segment.rect.y);
  if own && narrow < NARROW {
    return Place(relative(params, texel), normal, true);
  }
  let toward = dot(normal, direction);
  var depth = 0.5 * (segment.nearest + segment.farthest);
  if abs(toward) > 1e-6 * length(direction) {
    depth = dot(normal, relative(params, texel) - base) / toward;
  }
  var least = segment.nearest;
  var most = segment.farthest;
  if own {
    // Half a pixel along a plane changes the depth by no more than this.
    let half_pixel = 0.5 * (most - least) / f32(narrow);
    let middle = dot(params.along, relative(params, texel));
    least = middle - min(half_pixel, 0.5 * abs(middle));
    most = middle + half_pixel;
  }
  return Place(base + direction * clamp(depth, least, most), normal, own);
}
