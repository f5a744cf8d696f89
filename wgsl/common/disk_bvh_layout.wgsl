// Trees over the disks of each sub-buffer of each level, in the manner of wgsl/common/bvh4_layout.wgsl: surfels in the order
// in which a sub-buffer gets them, which is that of emission, four to a run. Nodes over single disks (depth 0) are left out.

#import bvh4_layout
#import levels

struct DiskBvh {
  // Surfels that the sub-buffer has, and has room for.
  count: u32,
  capacity: u32,
  // What depth_offset() counts from; below 0, which wraps, where depth 0 would begin before the first node.
  first: u32,
}

// `level_first` is where the nodes of the level begin; stored and capacity are the cloud's.
fn disk_bvh(level: u32, sub_buffer: u32, level_first: u32, stored: u32, capacity: u32) -> DiskBvh {
  let room = surfels_dealt(capacity, 0u, level);
  let nodes_each = depth_offset(room, top_of(room) + 1u) - depth_offset(room, 1u);
  let first = level_first + sub_buffer * nodes_each - depth_offset(room, 1u);
  return DiskBvh(surfels_dealt(stored, sub_buffer, level), room, first);
}

// A surfel's radius on a level.
fn radius_on(level: u32, radius: f32) -> f32 {
  return min(radius * f32(1u << level), FAR);
}
