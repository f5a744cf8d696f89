// Rays against senders: a ray visits the nodes over them from left to right, skips what it misses, and needs no stack.
//
// Asks of its importer the textures `nodes` and `leaves` (wgsl/sender_bounds.wgsl).

#import walk_tree

struct Ray {
  origin: vec3f,
  direction: vec3f,
  inverse: vec3f,
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
  return Ray(origin, direction, 1.0 / d);
}

// Where a ray of a surface starts: off it by more than the rounding of its position. `side` is its unit normal.
fn off_surface(position: vec3f, side: vec3f) -> vec3f {
  return position + side * (4.0 * POSITION_TOLERANCE * max_component(abs(position)));
}

fn node_texel(i: u32) -> vec4f {
  return textureLoad(nodes, vec2u(i % TEXELS_A_ROW, i / TEXELS_A_ROW), 0);
}

fn leaf_texel(i: u32) -> vec4f {
  return textureLoad(leaves, vec2u(i % TEXELS_A_ROW, i / TEXELS_A_ROW), 0);
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
  return select(vec4f(FAR), enter, enter * (1.0 - SLAB_TOLERANCE) <= min(leave, vec4f(t_max)));
}

struct Four {
  x: vec4f,
  y: vec4f,
  z: vec4f,
}

fn cross4(a: Four, b: Four) -> Four {
  return Four(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

fn dot4(a: Four, b: Four) -> vec4f {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

fn largest4(a: Four) -> vec4f {
  return max(abs(a.x), max(abs(a.y), abs(a.z)));
}

fn four(v: vec3f) -> Four {
  return Four(vec4f(v.x), vec4f(v.y), vec4f(v.z));
}

fn load_four(first: u32) -> Four {
  return Four(leaf_texel(first), leaf_texel(first + 1u), leaf_texel(first + 2u));
}

// Where a ray meets four triangles, from either side; FAR where it does not (Moeller and Trumbore 1997).
fn meet_leaf(ray: Ray, leaf: u32) -> vec4f {
  let a = load_four(leaf * LEAF_TEXELS);
  let e1 = load_four(leaf * LEAF_TEXELS + 3u);
  let e2 = load_four(leaf * LEAF_TEXELS + 6u);
  let d = four(ray.direction);
  let p = cross4(d, e2);
  let det = dot4(e1, p);
  let s = Four(ray.origin.x - a.x, ray.origin.y - a.y, ray.origin.z - a.z);
  let q = cross4(s, e1);
  let per_det = 1.0 / det;
  let u = dot4(s, p) * per_det;
  let v = dot4(d, q) * per_det;
  let t = dot4(e2, q) * per_det;
  // Moving the ray sideways by the rounding of positions moves u and v by this much.
  let size = largest4(e1) + largest4(e2);
  let slack = POSITION_TOLERANCE * (largest4(a) + max_component(abs(ray.origin))) * size * abs(per_det);
  // A ray within the triangle's plane passes it by; so does one whose figures left the range of f32.
  let inside = (u >= -slack) & (v >= -slack) & (u + v <= 1.0 + slack) & (t > vec4f(0.0)) & (abs(det) > vec4f(1e-35));
  return select(vec4f(FAR), t, inside);
}

#if STATISTICS
var<private> nodes_tested: u32;
var<private> senders_tested: u32;
#endif

// The nearest hit closer than t_max; of two at the same distance that of the sender that comes first. With `any` the
// first one found.
//
// Of the nodes on the way down from the top, two words keep which of their four are still to be visited: four bits a
// depth. The lowest bit is the next.
fn walk(ray: Ray, count: u32, capacity: u32, t_max: f32, any: bool) -> Hit {
  var hit = Hit(t_max, NO_SENDER);
  if count == 0u {
    return hit;
  }
  var depth = top_of(count);
  var i = 0u;
  var open = vec2u(0u);
  var done = false;
  while !done {
    while depth > 0u && !done {
#if STATISTICS
      nodes_tested++;
#endif
      let enter = enter_node(ray, depth_offset(capacity, depth) + i, hit.t);
      let meets = enter < vec4f(FAR);
      let bits = select(0u, 1u, meets.x) | select(0u, 2u, meets.y) | select(0u, 4u, meets.z) | select(0u, 8u, meets.w);
      let shift = (4u * depth) & 31u;
      open |= select(vec2u(bits << shift, 0u), vec2u(0u, bits << shift), depth >= 8u);
      // The next one.
      let low = select(countTrailingZeros(open.y) + 32u, countTrailingZeros(open.x), open.x != 0u);
      done = all(open == vec2u(0u));
      open = select(vec2u(0u, open.y & (open.y - 1u)), vec2u(open.x & (open.x - 1u), open.y), open.x != 0u);
      let parent = low / 4u;
      i = ((i >> (2u * (parent - depth))) << 2u) + (low & 3u);
      depth = parent - 1u;
    }
    if !done {
#if STATISTICS
      senders_tested++;
#endif
      let t = meet_leaf(ray, i);
      let nearest = min(min(t.x, t.y), min(t.z, t.w));
      if nearest < hit.t {
        let which = select(select(select(3u, 2u, t.z == nearest), 1u, t.y == nearest), 0u, t.x == nearest);
        hit = Hit(nearest, i * 4u + which);
      }
      done = any && hit.sender != NO_SENDER || all(open == vec2u(0u));
      let low = select(countTrailingZeros(open.y) + 32u, countTrailingZeros(open.x), open.x != 0u);
      open = select(vec2u(0u, open.y & (open.y - 1u)), vec2u(open.x & (open.x - 1u), open.y), open.x != 0u);
      let parent = select(low / 4u, 1u, done);
      i = ((i >> (2u * parent)) << 2u) + (low & 3u);
      depth = parent - 1u;
    }
  }
  return hit;
}
