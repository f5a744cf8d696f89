// The hull's vertices: four a segment, at the corners of its rectangle (Meder and Bruederlin 2018, section 3). Where corners
// of several segments of one surface meet, light is gathered once: so that a wall costs a vertex a quad, and is smooth
// across them. What is to be gathered is listed.
//
// @group(0) @binding(0) params, 1 receivers, 2 the segment of each pixel, 3 segments, 4 counters, 5 vertices, 6 the list

#import sg_hull
#import dispatch
#import spherical_gaussian
#import sg_hull_vertex
#import sg_hull_corner

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

// A corner's place: by its pixel in the segment's rectangle.
fn place(segment: Segment, id: u32, corner: u32) -> Place {
  let edge = edge_of(segment.rect.xy, segment.rect.zw, corner);
  return place_at(segment, id, edge, edge - vec2u(corner & 1u, corner >> 1u));
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
  let point = edge_of(segment.rect.xy, segment.rect.zw, corner);
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
      here = Place(receiver_position(anchor), unpack_normal(anchor.w), true);
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
    vertices[index] = HullVertex(here.position, view_depth(params, here.position), none, none, none,
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
