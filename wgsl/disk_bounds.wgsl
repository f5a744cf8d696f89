// DiskBounds: bounds over a cloud's surfels as disks, for rays to skip (wgsl/common/disk_bvh_traverse.wgsl). A tree for each
// sub-buffer of each level (wgsl/common/disk_bvh_layout.wgsl), in the order of emission, in which neighbours follow each other.
//
//   build_first   one thread per node over 16 surfels of a sub-buffer, on one level
//   build_next    one thread per node over four nodes, once a depth

#import math
#import packing
#import hashing
#import dispatch
#import surfel
#import disk_bvh_layout

alias Counter = u32;

struct Params {
  level: u32,
  depth: u32,
  // Surfels that the cloud has room for.
  capacity: u32,
  // Where the level's nodes begin.
  level_first: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> counters: Counters;
@group(0) @binding(2) var<storage, read> surfels: array<vec4f>;
@group(0) @binding(3) var<storage, read> sources: array<SurfelSource>;
@group(0) @binding(4) var<storage, read_write> nodes: array<vec4f>;

#import bvh4_boxes

fn box_of(surfel: u32) -> Box {
  let disk = surfels[surfel];
  if !(disk.w > 0.0) {
    return empty_box();
  }
  let normal = unpack_normal(sources[surfel].normal);
  // Half the extent of a disk along an axis is its radius times the sine to it. Rounding the normal can hide a sine of
  // 1e-3, and rounding positions moves a hit.
  let sine = sqrt(max(1.0 - normal * normal, vec3f(0.0)) + 1e-6);
  let half = min(radius_on(params.level, disk.w) * sine + POSITION_TOLERANCE * abs(disk.xyz), vec3f(FAR));
  return Box(disk.xyz - half, disk.xyz + half);
}

fn merged(a: Box, b: Box) -> Box {
  if a.low.x >= FAR {
    return b;
  }
  if b.low.x >= FAR {
    return a;
  }
  return Box(min(a.low, b.low), max(a.high, b.high));
}

struct Place {
  tree: DiskBvh,
  sub_buffer: u32,
  // Of the node within its depth.
  number: u32,
}

// The node that a thread makes: as many threads a sub-buffer as it has room for nodes.
fn place_of(thread: u32) -> Place {
  let nodes_each = nodes_at(surfels_dealt(params.capacity, 0u, params.level), params.depth);
  let sub_buffer = thread / nodes_each;
  let tree = disk_bvh(params.level, sub_buffer, params.level_first, counters.stored, params.capacity);
  return Place(tree, sub_buffer, thread % nodes_each);
}

fn is_node(place: Place) -> bool {
  return place.sub_buffer < (1u << (2u * params.level)) && place.number < nodes_at(place.tree.count, params.depth);
}

fn node_at(tree: DiskBvh, depth: u32, number: u32) -> u32 {
  return tree.first + depth_offset(tree.capacity, depth) + number;
}

// `radii`: the largest within each box, on level 0.
fn store_disks(node: u32, boxes: array<Box, 4>, radii: vec4f) {
  store_node(node, boxes);
  nodes[node * NODE_TEXELS + 6u] = radii;
}

@compute @workgroup_size(64)
fn build_first(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let place = place_of(linear_workgroup(workgroup) * 64u + thread);
  if !is_node(place) {
    return;
  }
  var boxes: array<Box, 4>;
  var radii = vec4f(0.0);
  for (var k = 0u; k < 4u; k++) {
    boxes[k] = empty_box();
    for (var j = 0u; j < 4u; j++) {
      let rank = place.number * 16u + k * 4u + j;
      if rank < place.tree.count {
        let surfel = surfel_dealt(rank, place.sub_buffer, params.level);
        boxes[k] = merged(boxes[k], box_of(surfel));
        radii[k] = max(radii[k], surfels[surfel].w);
      }
    }
  }
  store_disks(node_at(place.tree, params.depth, place.number), boxes, radii);
}

@compute @workgroup_size(64)
fn build_next(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let place = place_of(linear_workgroup(workgroup) * 64u + thread);
  if !is_node(place) {
    return;
  }
  var boxes: array<Box, 4>;
  var radii = vec4f(0.0);
  let below = nodes_at(place.tree.count, params.depth - 1u);
  for (var k = 0u; k < 4u; k++) {
    boxes[k] = empty_box();
    if place.number * 4u + k < below {
      let node = node_at(place.tree, params.depth - 1u, place.number * 4u + k);
      boxes[k] = box_of_node(node);
      let largest = nodes[node * NODE_TEXELS + 6u];
      radii[k] = max(max(largest.x, largest.y), max(largest.z, largest.w));
    }
  }
  store_disks(node_at(place.tree, params.depth, place.number), boxes, radii);
}
