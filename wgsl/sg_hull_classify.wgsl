// Quads that do not fit what they stand for, which are split (wgsl/sg_hull_split.wgsl) or gathered at each of their pixels, and
// these pixels (src/sg_hull).
//
// A quad does not fit where its corners disagree about the light on the segment, as beside a source or at the edge of one,
// where its normals lie so far off each other that one lobe is not enough, where it is of last resort, and where it is tiny.
//
// @group(0) @binding(0) params, 2 the segment of each pixel, 3 segments, 4 counters, 5 vertices, 6 the list of vertices, 7
// that of quads, 8 that of pixels, 9 the splits

#import sg_hull
#import dispatch
#import spherical_gaussian
#import sg_hull_vertex
#import sg_hull_split
#import sg_hull_error

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(2) var<storage, read> segment_of: array<u32>;
@group(0) @binding(3) var<storage, read> segments: array<Segment>;
@group(0) @binding(4) var<storage, read_write> counters: ClassifyCounters;
@group(0) @binding(5) var<storage, read_write> vertices: array<HullVertex>;
@group(0) @binding(6) var<storage, read> list: array<Gathering>;
@group(0) @binding(7) var<storage, read_write> rejected: array<RejectedQuad>;
// The light, and the pixel's number.
@group(0) @binding(8) var<storage, read_write> per_pixel: array<vec4u>;
@group(0) @binding(9) var<storage, read_write> splits: array<Split>;

// The first of Counters.
struct ClassifyCounters {
  segments: u32,
  fallbacks: u32,
  fallback_pixels: u32,
  gathered: u32,
  draw: vec4u,
  rejected: atomic<u32>,
  per_pixel: atomic<u32>,
  mean_irradiance: f32,
  splits: atomic<u32>,
}

// The bits of the brightest, and of shares of it the sums of their three bytes: vertices are listed in any order, and a sum
// of floats would depend on it.
var<workgroup> brightest: atomic<u32>;
var<workgroup> sums: array<atomic<u32>, 3>;

@compute @workgroup_size(256)
fn mean(@builtin(local_invocation_index) thread: u32) {
  // Lavapipe (Mesa 22.3) does not always begin with zeros.
  if thread < 3u {
    atomicStore(&sums[thread], 0u);
    atomicStore(&brightest, 0u);
  }
  workgroupBarrier();
  let count = counters.gathered;
  var most = 0.0;
  for (var k = thread; k < count; k += 256u) {
    most = max(most, average(vertices[list[k].vertex].irradiance));
  }
  atomicMax(&brightest, bitcast<u32>(most));
  workgroupBarrier();
  let unit = bitcast<f32>(atomicLoad(&brightest)) / 16777215.0;
  var bytes = vec3u(0u);
  for (var k = thread; k < count; k += 256u) {
    let share = u32(min(round(average(vertices[list[k].vertex].irradiance) / max(unit, 1e-37)), 16777215.0));
    bytes += vec3u(share, share >> 8u, share >> 16u) & vec3u(255u);
  }
  atomicAdd(&sums[0], bytes.x);
  atomicAdd(&sums[1], bytes.y);
  atomicAdd(&sums[2], bytes.z);
  workgroupBarrier();
  if thread == 0u {
    let shares = vec3f(f32(atomicLoad(&sums[0])), f32(atomicLoad(&sums[1])), f32(atomicLoad(&sums[2])));
    counters.mean_irradiance = dot(shares / f32(max(count, 1u)), vec3f(1.0, 256.0, 65536.0)) * unit;
  }
}

// How far a quad's light may be off, in mean irradiances: how far its corners lie apart, each asked for a surface with the
// segment's normal, which is kept; and a third of what normals as far apart as the segment's change where all light comes from
// aside.
fn error_of(segment: Segment, i: u32) -> f32 {
  let n = unpack_normal(segment.normal);
  var least = MAX_F32;
  var most = 0.0;
  var light = 0.0;
  for (var corner = 0u; corner < 4u; corner++) {
    let vertex = vertices[vertices[i * 4u + corner].owner];
    let irradiance = vec3f(lobe_irradiance(vertex.red, vertex.excess.x, n),
      lobe_irradiance(vertex.green, vertex.excess.y, n), lobe_irradiance(vertex.blue, vertex.excess.z, n));
    vertices[i * 4u + corner].irradiance = irradiance;
    let found = average(irradiance);
    least = min(least, found);
    most = max(most, found);
    light += 0.25 * average(vec3f(vertex.red.w, vertex.green.w, vertex.blue.w));
  }
  let mean = counters.mean_irradiance;
  return relative_error(max(most - least, 0.3 * segment.spread * light), least, mean);
}

@compute @workgroup_size(64)
fn classify(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= counters.draw.y {
    return;
  }
  let slot = segment_slot(params, counters.segments, i);
  let segment = segments[slot];
  // No number is no fit.
  let fits = error_of(segment, i) < params.error_threshold;
  let by_pixels = slot >= first_fallback(params) || is_tiny(segment);
  if fits && !by_pixels {
    return;
  }
  let low = segment.rect.xy;
  let high = segment.rect.zw;
  // Without any error allowed, corners do not do.
  if !by_pixels && is_flat(segment) && can_be_split(low, high) && params.split_room > 0u && params.error_threshold > 0.0 {
    let split = atomicAdd(&counters.splits, 1u);
    if split < params.split_room {
      var whole = Part(pack_pixel(low), pack_pixel(high), slot, 0u, array<vec4f, 4>());
      for (var corner = 0u; corner < 4u; corner++) {
        let vertex = vertices[i * 4u + corner];
        whole.corners[corner] = vec4f(vertex.irradiance, vertex.depth);
      }
      splits[split].whole = whole;
      return;
    }
  }
  rejected[atomicAdd(&counters.rejected, 1u)] = RejectedQuad(slot, pack_pixel(low), pack_pixel(high), 0u);
}

@compute @workgroup_size(64)
fn list_pixels(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let k = linear_workgroup(workgroup);
  let count = atomicLoad(&counters.rejected);
  if k >= count {
    return;
  }
  let quad = rejected[k];
  let low = unpack_pixel(quad.low);
  let size = unpack_pixel(quad.high) - low;
  for (var j = thread; j < size.x * size.y; j += 64u) {
    let pixel = (low.y + j / size.x) * params.camera.viewport.z + low.x + j % size.x;
    if segment_of[pixel] == quad.slot {
      let at = atomicAdd(&counters.per_pixel, 1u);
      if at < params.per_pixel_capacity {
        per_pixel[at] = vec4u(0u, 0u, 0u, pixel);
      }
    }
  }
}
