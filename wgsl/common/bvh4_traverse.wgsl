// Rays against primitives: a ray visits the nodes over them from left to right, skips what it misses, and needs no stack.
//
// The importer declares the texture `nodes`, intersect_leaf(), which tells where a ray meets the four primitives of a run, and
// for disks reach_of(), the distance beyond which a ray meets none with such radii.

#needs nodes intersect_leaf reach_of

#import bvh4_layout

fn node_texel(i: u32) -> vec4f {
  return textureLoad(nodes, vec2u(i % TEXELS_A_ROW, i / TEXELS_A_ROW), 0);
}

// How far a ray goes before it may meet each of a node's four; FAR where it does not below t_max.
fn intersect_node(ray: Ray, node: u32, t_max: f32) -> vec4f {
  let first = node * NODE_TEXELS;
  let x0 = (node_texel(first) - ray.origin.x) * ray.inverse.x;
  let y0 = (node_texel(first + 1u) - ray.origin.y) * ray.inverse.y;
  let z0 = (node_texel(first + 2u) - ray.origin.z) * ray.inverse.z;
  let x1 = (node_texel(first + 3u) - ray.origin.x) * ray.inverse.x;
  let y1 = (node_texel(first + 4u) - ray.origin.y) * ray.inverse.y;
  let z1 = (node_texel(first + 5u) - ray.origin.z) * ray.inverse.z;
  let enter = max(max(min(x0, x1), min(y0, y1)), max(min(z0, z1), vec4f(0.0)));
  let leave = min(min(max(x0, x1), max(y0, y1)), max(z0, z1)) * (1.0 + SLAB_TOLERANCE);
  let end = min(vec4f(t_max), reach_of(node_texel(first + 6u)));
  return select(vec4f(FAR), enter, enter * (1.0 - SLAB_TOLERANCE) <= min(leave, end));
}

// Nodes of a ray still to be visited: of each node on the way down from the top, which of its four. Four bits a depth, so
// that the lowest bit is the next.
struct Pending {
  bits: vec2u,
}

fn with_node(pending: Pending, depth: u32, bits: u32) -> Pending {
  let shift = (4u * depth) & 31u;
  return Pending(pending.bits | select(vec2u(bits << shift, 0u), vec2u(0u, bits << shift), depth >= 8u));
}

fn is_empty(pending: Pending) -> bool {
  return (pending.bits.x | pending.bits.y) == 0u;
}

fn next_of(pending: Pending) -> u32 {
  return select(countTrailingZeros(pending.bits.y) + 32u, countTrailingZeros(pending.bits.x), pending.bits.x != 0u);
}

fn without_next(pending: Pending) -> Pending {
  let b = pending.bits;
  return Pending(select(vec2u(0u, b.y & (b.y - 1u)), vec2u(b.x & (b.x - 1u), b.y), b.x != 0u));
}

fn least4(v: vec4f) -> f32 {
  return min(min(v.x, v.y), min(v.z, v.w));
}

// The first of four that is the least.
fn which4(v: vec4f, least: f32) -> u32 {
  return select(select(select(3u, 2u, v.z == least), 1u, v.y == least), 0u, v.x == least);
}

// The nearest hit closer than t_max, among the primitives of one of several trees, whose nodes begin at `first`; of two at the
// same distance that of the primitive with the lower index. With `any` the first one found.
fn bvh4_nearest(ray: Ray, first: u32, count: u32, capacity: u32, t_max: f32, any: bool) -> Hit {
  var hit = Hit(t_max, MISS);
  if count == 0u {
    return hit;
  }
  var depth = top_of(count);
  var i = 0u;
  var pending = Pending(vec2u(0u));
  var done = false;
  while !done {
    // Down to the next leaf: of a node's four first into the one that the ray enters first.
    while depth > 0u && !done {
#if STATISTICS
      nodes_visited++;
#endif
      let enter = intersect_node(ray, first + depth_offset(capacity, depth) + i, hit.t);
      let nearest = least4(enter);
      let into = nearest < FAR;
      let which = which4(enter, nearest);
      let met = vec4u(1u, 2u, 4u, 8u) * select(vec4u(0u), vec4u(1u), enter < vec4f(FAR));
      let others = (met.x | met.y | met.z | met.w) & ~(1u << which);
      // Or, where it enters none, to the next one that is pending.
      let next = next_of(pending);
      done = !into && is_empty(pending);
      let parent = select(next / 4u, depth, into || done);
      let child = select(next & 3u, which, into);
      i = ((i >> (2u * (parent - depth))) << 2u) + child;
      if into {
        pending = with_node(pending, depth, others);
      } else {
        pending = without_next(pending);
      }
      depth = parent - 1u;
    }
    if !done {
#if STATISTICS
      primitives_tested += 4u;
#endif
      let t = intersect_leaf(ray, i);
      let nearest = least4(t);
      let primitive = i * 4u + which4(t, nearest);
      // Nothing has been hit yet at t_max itself.
      let before = nearest == hit.t && primitive < hit.primitive && hit.primitive != MISS;
      if nearest < hit.t || before {
        hit = Hit(nearest, primitive);
      }
      done = (any && hit.primitive != MISS) || is_empty(pending);
      let next = next_of(pending);
      let parent = select(next / 4u, 1u, done);
      i = ((i >> (2u * parent)) << 2u) + (next & 3u);
      pending = without_next(pending);
      depth = parent - 1u;
    }
  }
  return hit;
}
