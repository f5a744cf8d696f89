// The hull's vertices: four a segment, at the corners of its rectangle (Meder and Bruederlin 2018, section 3). Where corners
// of several segments of one surface meet, light is gathered once: so that a wall costs a vertex a quad, and is smooth
// across them. What is to be gathered is listed.
//
// @group(0) @binding(0) params, 1 receivers, 2 the segment of each pixel, 3 segments, 4 counters, 5 vertices, 6 the list

#import sg_hull
#import dispatch
#import spherical_gaussian
#import sg_hull_vertex

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var receivers: texture_2d<u32>;
@group(0) @binding(2) var<storage, read> segment_of: array<u32>;
@group(0) @binding(3) var<storage, read> segments: array<Segment>;
@group(0) @binding(4) var<storage, read_write> counters: PlaceCounters;
@group(0) @binding(5) var<storage, read_write> vertices: array<HullVertex>;
@group(0) @binding(6) var<storage, read_write> list: array<Gathering>;

// The first of Counters.
struct PlaceCounters {
  segments: u32,
  fallbacks: u32,
  fallback_pixels: u32,
  gathered: atomic<u32>,
  draw: vec4u,
}

var<workgroup> listed: atomic<u32>;
var<workgroup> first: u32;

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

// Where a vertex lies: where the ray through the corner meets the plane of the corner's pixel if that is the segment's own,
// and the segment's plane otherwise, within the range of its depth. The paper takes the middle of that range, which no
// plane that is seen obliquely goes through; and a pixel's own point is half a pixel off, which neighbours cannot share. Of a
// sliver, often a ledge seen edge-on, half a pixel on is elsewhere: there it is the pixel's own.
fn place(segment: Segment, id: u32, corner: u32) -> Place {
  let width = params.camera.viewport.z;
  let edge = vec2u(select(segment.rect.x, segment.rect.z, (corner & 1u) != 0u),
    select(segment.rect.y, segment.rect.w, (corner & 2u) != 0u));
  let pixel = vec2u(select(edge.x, edge.x - 1u, (corner & 1u) != 0u), select(edge.y, edge.y - 1u, (corner & 2u) != 0u));
  let own = segment_of[pixel.y * width + pixel.x] == id;
  // The ray through the corner, as a function of the depth along the axis.
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

// A segment that has a pixel as its corner, and what the pixel is.
struct Meeting {
  // A vertex of it.
  vertex: u32,
  texel: vec4u,
  exists: bool,
}

// The place among the quads of a segment: the inverse of segment_slot.
fn quad_of(slot: u32) -> u32 {
  let limit = first_fallback(params);
  return select(min(counters.segments, limit) + (slot - limit), slot, slot < limit);
}

// The k-th of the four pixels around a point, rows from the top: the segment that has the point as its corner there.
fn meeting(point: vec2u, k: u32) -> Meeting {
  var none: Meeting;
  // Of the pixel on the upper left, the point is the lower right corner.
  let corner = 3u - k;
  let inside = vec2u(corner & 1u, corner >> 1u);
  let viewport = params.camera.viewport.zw;
  if any(point < inside) || any(point - inside >= viewport) {
    return none;
  }
  let pixel = point - inside;
  let slot = segment_of[pixel.y * viewport.x + pixel.x];
  if slot >= params.capacity {
    return none;
  }
  let segment = segments[slot];
  let edge = select(segment.rect.xy, segment.rect.zw, inside == vec2u(1u));
  if any(edge != point) || is_tiny(segment) {
    return none;
  }
  return Meeting(quad_of(slot) * 4u + corner, textureLoad(receivers, pixel, 0), true);
}

// The vertex that gathers for a corner that is a pixel of its segment: of those that meet in its point, the first that is
// one surface with it and gathers itself. All that meet there decide alike.
fn owner_of(segment: Segment, corner: u32, vertex: u32) -> u32 {
  let point = vec2u(select(segment.rect.x, segment.rect.z, (corner & 1u) != 0u),
    select(segment.rect.y, segment.rect.w, (corner & 2u) != 0u));
  let own = 3u - corner;
  var met: array<Meeting, 4>;
  for (var k = 0u; k <= own; k++) {
    var here = meeting(point, k);
    var owner = here.vertex;
    for (var j = 0u; j < k && here.exists; j++) {
      if met[j].exists && similar(params, met[j].texel, here.texel) {
        owner = met[j].vertex;
        // Only those that gather are met by the next.
        here.exists = false;
      }
    }
    if k == own {
      return owner;
    }
    met[k] = here;
  }
  return vertex;
}

@compute @workgroup_size(64)
fn place_vertices(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  if thread == 0u {
    atomicStore(&listed, 0u);
  }
  workgroupBarrier();
  let index = linear_workgroup(workgroup) * 64u + thread;
  let i = index / 4u;
  let exists = i < counters.draw.y;
  var here: Place;
  var owner = index;
  var is_listed = false;
  var rank = 0u;
  if exists {
    let slot = segment_slot(params, counters.segments, i);
    let segment = segments[slot];
    if is_tiny(segment) {
      let anchor = textureLoad(receivers, pixel_at(segment.anchor), 0);
      here = Place(relative(params, anchor), unpack_normal(anchor.w), true);
      owner = index - index % 4u;
      // One vertex at the anchor, for when the pixels find no room.
      is_listed = owner == index && !has_room(params);
    } else {
      here = place(segment, slot, index % 4u);
      if here.on_surface {
        owner = owner_of(segment, index % 4u, index);
      }
      is_listed = owner == index;
    }
    let none = vec4f(0.0);
    vertices[index] = HullVertex(here.position + params.camera.eye, dot(params.along, here.position), none, none, none,
      vec3f(0.0), owner, vec3f(0.0), 0u);
    if is_listed {
      rank = atomicAdd(&listed, 1u);
    }
  }
  workgroupBarrier();
  if thread == 0u {
    first = atomicAdd(&counters.gathered, atomicLoad(&listed));
  }
  workgroupBarrier();
  if is_listed {
    list[first + rank] = Gathering(index, pack_normal(here.normal));
  }
}
