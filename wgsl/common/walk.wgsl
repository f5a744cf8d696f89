// Rays against senders: a ray visits the nodes over them from left to right, skips what it misses, and needs no stack.
//
// The importer declares the texture `nodes`, meet_leaf(), which tells where a ray meets the four senders of a run, and for
// disks reach_of(), the distance beyond which a ray meets none with such radii.

#needs nodes meet_leaf reach_of

#import walk_tree

fn node_texel(i: u32) -> vec4f {
  return textureLoad(nodes, vec2u(i % TEXELS_A_ROW, i / TEXELS_A_ROW), 0);
}

// How far a ray goes before it may meet each of a node's four; FAR where it does not below t_max.
fn enter_node(ray: Ray, node: u32, t_max: f32) -> vec4f {
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
struct Open {
  bits: vec2u,
}

fn with_node(open: Open, depth: u32, bits: u32) -> Open {
  let shift = (4u * depth) & 31u;
  return Open(open.bits | select(vec2u(bits << shift, 0u), vec2u(0u, bits << shift), depth >= 8u));
}

fn is_empty(open: Open) -> bool {
  return (open.bits.x | open.bits.y) == 0u;
}

fn next_of(open: Open) -> u32 {
  return select(countTrailingZeros(open.bits.y) + 32u, countTrailingZeros(open.bits.x), open.bits.x != 0u);
}

fn without_next(open: Open) -> Open {
  let b = open.bits;
  return Open(select(vec2u(0u, b.y & (b.y - 1u)), vec2u(b.x & (b.x - 1u), b.y), b.x != 0u));
}

fn least4(v: vec4f) -> f32 {
  return min(min(v.x, v.y), min(v.z, v.w));
}

// The first of four that is the least.
fn which4(v: vec4f, least: f32) -> u32 {
  return select(select(select(3u, 2u, v.z == least), 1u, v.y == least), 0u, v.x == least);
}

// The nearest hit closer than t_max, among the senders of one of several trees, whose nodes begin at `first`; of two at the
// same distance that of the sender with the lower index. With `any` the first one found.
fn walk_from(ray: Ray, first: u32, count: u32, capacity: u32, t_max: f32, any: bool) -> Hit {
  var hit = Hit(t_max, MISS);
  if count == 0u {
    return hit;
  }
  var depth = top_of(count);
  var i = 0u;
  var open = Open(vec2u(0u));
  var done = false;
  while !done {
    // Down to the next leaf: of a node's four first into the one that the ray enters first.
    while depth > 0u && !done {
#if STATISTICS
      nodes_visited++;
#endif
      let enter = enter_node(ray, first + depth_offset(capacity, depth) + i, hit.t);
      let nearest = least4(enter);
      let into = nearest < FAR;
      let which = which4(enter, nearest);
      let met = vec4u(1u, 2u, 4u, 8u) * select(vec4u(0u), vec4u(1u), enter < vec4f(FAR));
      let others = (met.x | met.y | met.z | met.w) & ~(1u << which);
      // Or, where it enters none, to the next one that is open.
      let next = next_of(open);
      done = !into && is_empty(open);
      let parent = select(next / 4u, depth, into || done);
      let child = select(next & 3u, which, into);
      i = ((i >> (2u * (parent - depth))) << 2u) + child;
      if into {
        open = with_node(open, depth, others);
      } else {
        open = without_next(open);
      }
      depth = parent - 1u;
    }
    if !done {
#if STATISTICS
      primitives_tested += 4u;
#endif
      let t = meet_leaf(ray, i);
      let nearest = least4(t);
      let sender = i * 4u + which4(t, nearest);
      // Nothing has been hit yet at t_max itself.
      let before = nearest == hit.t && sender < hit.primitive && hit.primitive != MISS;
      if nearest < hit.t || before {
        hit = Hit(nearest, sender);
      }
      done = (any && hit.primitive != MISS) || is_empty(open);
      let next = next_of(open);
      let parent = select(next / 4u, 1u, done);
      i = ((i >> (2u * parent)) << 2u) + (next & 3u);
      open = without_next(open);
      depth = parent - 1u;
    }
  }
  return hit;
}
