// InstancedBvh: meshes in their own space, and where their instances are.
//
//   make_pieces      one thread per triangle of a mesh, relative to the mesh's first vertex
//   place_instances  one thread per instance of a mesh: its box, and what takes rays to the mesh's space
//
// Over either wgsl/bvh_order.wgsl, bvh_cluster.wgsl and bvh_collapse.wgsl build a hierarchy.

#import math
#import dispatch
#import surfel
#import instance
#import mesh
#if ALPHA_TESTED
#import cutout
#import tex_coords
#endif
#import bvh_layout

alias Counter = u32;
alias StateWord = u32;

#import bvh_build

struct Place {
  // What the scene is relative to, as two floats a coordinate: high + low.
  origin_high: vec3f,
  // The mesh's root and its first triangle.
  first_node: u32,
  origin_low: vec3f,
  first_triangle: u32,
  mesh: u32,
  first_instance: u32,
  // Of all meshes.
  instances: u32,
  padding: u32,
}

// Of one recording, readable by the caller: InstancedCounts of src/instanced_bvh.
struct Counts {
  instances: atomic<u32>,
  left_out: atomic<u32>,
}

@group(0) @binding(0) var<uniform> mesh: Mesh;
@group(0) @binding(1) var<uniform> place: Place;
@group(0) @binding(2) var<storage, read> vertices: array<u32>;
@group(0) @binding(3) var<storage, read> indices: array<u32>;
@group(0) @binding(4) var<storage, read> transforms: array<u32>;
// What the stages that follow are told: how many primitives there are, and where their hierarchy goes.
@group(0) @binding(5) var<storage, read_write> counters: Counters;
@group(0) @binding(6) var<storage, read_write> state: State;
@group(0) @binding(7) var<storage, read_write> pieces: array<Piece>;
// Each mesh's first vertex, which its hierarchy is relative to: a mesh far from the origin of its own space keeps its digits.
@group(0) @binding(8) var<storage, read_write> anchors: array<vec4f>;
@group(0) @binding(9) var nodes: texture_2d<u32>;
@group(0) @binding(10) var<storage, read_write> instances: array<Instance>;
@group(0) @binding(11) var<storage, read_write> counts: Counts;
#if ALPHA_TESTED
@group(0) @binding(12) var<uniform> alpha_test: AlphaTest;
@group(0) @binding(13) var<storage, read> tex_coords: array<u32>;
@group(0) @binding(14) var<storage, read_write> cutouts: array<Cutout>;
#endif

// What is beyond all range, and never met.
const NOWHERE: f32 = 3e38;

@compute @workgroup_size(64)
fn make_pieces(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= mesh.triangles {
    return;
  }
  var anchor = vec3f(0.0);
  let first = vertex_index(0u);
  if first != NO_VERTEX {
    let position = vertex_position(first);
    anchor = select(anchor, position, is_finite3(position));
  }
  if i == 0u {
    counters.pieces = mesh.triangles;
    state.first_node = place.first_node;
    state.first_triangle = place.first_triangle;
    anchors[place.mesh] = vec4f(anchor, 0.0);
  }
  var t = array<vec3f, 3>(vec3f(NOWHERE), vec3f(NOWHERE), vec3f(NOWHERE));
  let corners = vertices_of(i);
  if all(corners != vec3u(NO_VERTEX)) {
    t = array<vec3f, 3>(vertex_position(corners.x), vertex_position(corners.y), vertex_position(corners.z));
  }
  pieces[i] = Piece(t[0] - anchor, mesh.material, t[1] - anchor, 0u, t[2] - anchor, i);
#if ALPHA_TESTED
  cutouts[i] = cutout_of(corners);
#endif
}

// The box of the mesh, as its root has it.
fn mesh_box() -> Box {
  let at = node_texel_at(place.first_node);
  let head = textureLoad(nodes, at, 0);
  let b = textureLoad(nodes, at + vec2u(3u, 0u), 0);
  let c = textureLoad(nodes, at + vec2u(4u, 0u), 0);
  let step = bitcast<vec3f>(((vec3u(head.w) >> vec3u(0u, 8u, 16u)) & vec3u(0xffu)) << vec3u(23u));
  let low = bitcast<vec3f>(head.xyz);
  var steps = vec3u(0u);
  for (var shift = 0u; shift < 32u; shift += 8u) {
    let half0 = (vec3u(b.z, c.x, c.z) >> vec3u(shift)) & vec3u(0xffu);
    let half1 = (vec3u(b.w, c.y, c.w) >> vec3u(shift)) & vec3u(0xffu);
    steps = max(steps, max(half0, half1));
  }
  return Box(low, low + vec3f(steps) * step);
}

fn length_of(v: vec3f) -> f32 {
  let scale = max(max_component(abs(v)), 1e-30);
  return scale * length(v / scale);
}

// Of axes shorter or longer than this a ray's direction may leave the range of f32; and axes that leave a volume of less
// between vectors of length 1 have no inverse that is known to more than a digit.
const SHORTEST: f32 = 1e-15;
const FLATTEST: f32 = 1e-6;

@compute @workgroup_size(64)
fn place_instances(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let i = linear_workgroup(workgroup) * 64u + thread;
  if i >= mesh.instances {
    return;
  }
  if i == 0u {
    counters.pieces = place.instances;
    state.first_node = 0u;
    state.first_triangle = 0u;
  }
  let anchor = anchors[place.mesh].xyz;
  var m = mat3x3f(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), vec3f(0.0, 0.0, 1.0));
  var shift = relative_to(place.origin_high, place.origin_low, anchor);
  if mesh.instance_format != 0u {
    let base = mesh.instance_offset + i * mesh.instance_stride;
    m = mat3x3f(transform_column(base, 0u), transform_column(base, 1u), transform_column(base, 2u));
    shift = m * anchor + relative_to(place.origin_high, place.origin_low, transform_column(base, 3u));
  }
  // Axes of length 1 first: scales are then exact, however different.
  let scale = vec3f(length_of(m[0]), length_of(m[1]), length_of(m[2]));
  let axes = mat3x3f(m[0] / scale.x, m[1] / scale.y, m[2] / scale.z);
  let volume = dot(axes[0], cross(axes[1], axes[2]));
  let own = mesh_box();
  let center = m * (0.5 * own.low + 0.5 * own.high) + shift;
  let sizes = mat3x3f(abs(m[0]), abs(m[1]), abs(m[2]));
  let margin = POSITION_TOLERANCE * (sizes * max(abs(own.low), abs(own.high)) + abs(shift));
  let extent = sizes * (0.5 * own.high - 0.5 * own.low) + margin;
  let is_usable = is_finite3(scale) && is_finite3(shift) && min(scale.x, min(scale.y, scale.z)) >= SHORTEST
    && max_component(scale) <= 1.0 / SHORTEST && abs(volume) >= FLATTEST
    && is_finite3(center) && is_finite3(extent) && max_component(abs(center) + extent) <= FAR;
  atomicAdd(&counts.instances, 1u);
  var instance: Instance;
  instance.low = vec3f(NOWHERE);
  instance.high = vec3f(NOWHERE);
  if is_usable {
    instance.low = center - extent;
    instance.high = center + extent;
    instance.root = place.first_node;
    instance.material = mesh.material;
    instance.x = cross(axes[1], axes[2]) / (volume * scale.x);
    instance.y = cross(axes[2], axes[0]) / (volume * scale.y);
    instance.z = cross(axes[0], axes[1]) / (volume * scale.z);
    instance.shift = shift;
  } else {
    atomicAdd(&counts.left_out, 1u);
  }
  instance.index = place.first_instance + i;
  instances[place.first_instance + i] = instance;
}
