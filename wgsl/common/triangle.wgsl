// Triangles and their longest-edge bisection, whose leaves are the surfels' own triangles. Needs math.

struct Triangle {
  a: vec3f,
  b: vec3f,
  c: vec3f,
}

// Twice the area along the normal, divided by `scale` squared: products of edges would underflow below 1e-19.
struct AreaVector {
  direction: vec3f,
  scale: f32,
}

fn area_vector(t: Triangle) -> AreaVector {
  let e1 = t.b - t.a;
  let e2 = t.c - t.a;
  let scale = max(max_component(abs(e1)), max_component(abs(e2)));
  if !(scale > 0.0) || !is_finite(scale) {
    return AreaVector(vec3f(0.0), 0.0);
  }
  return AreaVector(cross(e1 / scale, e2 / scale), scale);
}

fn centroid(t: Triangle) -> vec3f {
  return (t.a + t.b + t.c) * (1.0 / 3.0);
}

fn length2(v: vec3f) -> f32 {
  return dot(v, v);
}

// Which edge is the longest: 0 for ab, 1 for bc, 2 for ca. Near ties go to the first, so that symmetric triangles
// split alike whatever the rounding.
fn longest_edge(t: Triangle) -> u32 {
  let ab = length2(t.b - t.a);
  let bc = length2(t.c - t.b);
  let ca = length2(t.a - t.c);
  var longest = 0u;
  var best = ab;
  if bc > best * 1.001 {
    longest = 1u;
    best = bc;
  }
  if ca > best * 1.001 {
    longest = 2u;
  }
  return longest;
}

// One half of a triangle cut at the middle of its longest edge; both keep the winding.
fn bisect(t: Triangle, side: u32) -> Triangle {
  var first: Triangle;
  switch longest_edge(t) {
    case 0u: {
      first = t;
    }
    case 1u: {
      first = Triangle(t.b, t.c, t.a);
    }
    default: {
      first = Triangle(t.c, t.a, t.b);
    }
  }
  let middle = (first.a + first.b) * 0.5;
  if side == 0u {
    return Triangle(first.a, middle, first.c);
  }
  return Triangle(middle, first.b, first.c);
}

// A leaf of a triangle's bisection tree of depth `order`: the last `order` bits are the sides taken, first split first.
fn leaf_of(triangle: Triangle, leaf: u32, order: u32) -> Triangle {
  var node = triangle;
  for (var depth = 0u; depth < order; depth++) {
    node = bisect(node, (leaf >> (order - 1u - depth)) & 1u);
  }
  return node;
}

// The leaf that a point of the triangle's plane lies in.
fn leaf_at(triangle: Triangle, point: vec3f, order: u32) -> u32 {
  let normal = cross(triangle.b - triangle.a, triangle.c - triangle.a);
  var node = triangle;
  var leaf = 0u;
  for (var depth = 0u; depth < order; depth++) {
    let first = bisect(node, 0u);
    // The cut goes from the middle of the longest edge to the corner across, b and c of the first half.
    let across = dot(cross(first.c - first.b, point - first.b), normal);
    let side = select(0u, 1u, across < 0.0);
    leaf = leaf * 2u + side;
    if side == 0u {
      node = first;
    } else {
      node = bisect(node, 1u);
    }
  }
  return leaf;
}
