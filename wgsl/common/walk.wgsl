// Rays against senders: a ray visits the nodes over them from left to right, skips what it misses, and needs no stack.
//
// The importer declares the texture `nodes`, meet_leaf(), which tells where a ray meets the four senders of a run, and for
// disks reach_of(), the distance beyond which a ray meets none with such radii.

#needs nodes meet_leaf
#if SENDER_DISKS
#needs reach_of
#endif

#import walk_tree

struct Ray {
  origin: vec3f,
  direction: vec3f,
  inverse: vec3f,
#if SHADOW_RAYS
  // The size of the coordinates of the light that it ends at, which may lie on a surface; negative where it ends at none.
  end_size: f32,
#endif
}

struct Hit {
  t: f32,
  // Index of the sender, or NO_SENDER.
  sender: u32,
}

const NO_SENDER: u32 = 0xffffffffu;
// Rounding of a slab test, relative to its distances.
const SLAB_TOLERANCE: f32 = 1e-6;

fn make_ray(origin: vec3f, direction: vec3f) -> Ray {
  // A component of zero would give infinity, and 0 times infinity in the slab test.
  let d = select(direction, vec3f(1e-18), abs(direction) < vec3f(1e-18));
#if SHADOW_RAYS
  return Ray(origin, direction, 1.0 / d, -1.0);
#else
  return Ray(origin, direction, 1.0 / d);
#endif
}

// How far a ray starts off what it leaves: by more than the rounding of a position.
fn rounding(position: vec3f) -> f32 {
  return 4.0 * POSITION_TOLERANCE * max_component(abs(position));
}

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
#if SENDER_DISKS
  let end = min(vec4f(t_max), reach_of(node_texel(first + 6u)));
#else
  let end = vec4f(t_max);
#endif
  return select(vec4f(FAR), enter, enter * (1.0 - SLAB_TOLERANCE) <= min(leave, end));
}

#if STATISTICS
var<private> nodes_tested: u32;
var<private> leaves_tested: u32;
#endif

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

// The nearest hit closer than t_max; of two at the same distance that of the sender with the lower index. With `any`
// the first one found.
fn walk(ray: Ray, count: u32, capacity: u32, t_max: f32, any: bool) -> Hit {
  return walk_from(ray, 0u, count, capacity, t_max, any);
}

// The same among the senders of one of several trees, whose nodes begin at `first`.
fn walk_from(ray: Ray, first: u32, count: u32, capacity: u32, t_max: f32, any: bool) -> Hit {
  var hit = Hit(t_max, NO_SENDER);
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
      nodes_tested++;
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
      leaves_tested++;
#endif
      let t = meet_leaf(ray, i);
      let nearest = least4(t);
      let sender = i * 4u + which4(t, nearest);
      // Nothing has been hit yet at t_max itself.
      let before = nearest == hit.t && sender < hit.sender && hit.sender != NO_SENDER;
      if nearest < hit.t || before {
        hit = Hit(nearest, sender);
      }
      done = (any && hit.sender != NO_SENDER) || is_empty(open);
      let next = next_of(open);
      let parent = select(next / 4u, 1u, done);
      i = ((i >> (2u * parent)) << 2u) + (next & 3u);
      open = without_next(open);
      depth = parent - 1u;
    }
  }
  return hit;
}
