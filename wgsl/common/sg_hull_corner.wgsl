// Where points of a segment between its pixels lie: corners of quads and of their parts (src/sg_hull).

#needs params receivers segment_of

#import sg_hull

// Pixels across below which a segment is a sliver.
const NARROW: u32 = 4u;

struct Place {
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
  let base = params.rays.base * vec3f(ndc, 1.0);
  let direction = params.rays.direction * vec3f(ndc, 1.0);
  let texel = textureLoad(receivers, select(pixel_at(segment.anchor), pixel, own), 0);
  let normal = unpack_normal(select(segment.normal, texel.w, own));
  let narrow = min(segment.rect.z - segment.rect.x, segment.rect.w - segment.rect.y);
  if own && narrow < NARROW {
    return Place(receiver_position(texel), normal, true);
  }
  // Depths from here on are from the origin; the segment's have lost what the eye's distance rounds away.
  let eye_depth = dot(params.along, params.camera.eye);
  let slack = 2.5e-7 * max(abs(segment.nearest), abs(segment.farthest));
  var least = segment.nearest + eye_depth - slack;
  var most = segment.farthest + eye_depth + slack;
  let toward = dot(normal, direction);
  var depth = 0.5 * (least + most);
  if abs(toward) > 1e-6 * length(direction) {
    depth = dot(normal, receiver_position(texel) - base) / toward;
  }
  if own {
    // Half a pixel along a plane changes the depth by no more than this.
    var half_pixel = 0.5 * (most - least) / f32(narrow);
    let middle = dot(params.along, receiver_position(texel));
    most = middle + half_pixel;
    if params.camera.perspective != 0u {
      half_pixel = min(half_pixel, 0.5 * abs(middle - eye_depth));
    }
    least = middle - half_pixel;
  }
  return Place(base + direction * clamp(depth, least, most), normal, own);
}
