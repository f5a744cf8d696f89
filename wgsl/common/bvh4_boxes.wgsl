// Boxes around primitives and nodes, as the nodes of wgsl/common/bvh4_layout.wgsl hold them.
//
// The importer declares the array of vectors `nodes`, to write.

#needs nodes

#import bvh4_layout

struct Box {
  low: vec3f,
  high: vec3f,
}

// A point beyond all reach: no ray meets it.
fn empty_box() -> Box {
  return Box(vec3f(FAR), vec3f(FAR));
}

// The box around a node's four.
fn box_of_node(node: u32) -> Box {
  let first = node * NODE_TEXELS;
  var box: Box;
  for (var axis = 0u; axis < 3u; axis++) {
    let low = nodes[first + axis];
    let high = nodes[first + 3u + axis];
    box.low[axis] = min(min(low.x, low.y), min(low.z, low.w));
    let full = select(high, vec4f(-FAR), low >= vec4f(FAR));
    box.high[axis] = max(max(full.x, full.y), max(full.z, full.w));
  }
  return box;
}

fn store_node(node: u32, boxes: array<Box, 4>) {
  for (var axis = 0u; axis < 3u; axis++) {
    nodes[node * NODE_TEXELS + axis] = vec4f(boxes[0].low[axis], boxes[1].low[axis], boxes[2].low[axis], boxes[3].low[axis]);
    nodes[node * NODE_TEXELS + 3u + axis] = vec4f(boxes[0].high[axis], boxes[1].high[axis], boxes[2].high[axis], boxes[3].high[axis]);
  }
}
