// Longest-edge bisection: how a piece (src/surfel.rs) is cut into its leaves.

struct Triangle {
  a: vec3f,
  b: vec3f,
  c: vec3f,
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

// The triangle turned so that its longest edge is ab; the winding stays.
fn longest_first(t: Triangle) -> Triangle {
  switch longest_edge(t) {
    case 0u: {
      return t;
    }
    case 1u: {
      return Triangle(t.b, t.c, t.a);
    }
    default: {
      return Triangle(t.c, t.a, t.b);
    }
  }
}

// One half of a triangle cut at the middle of its longest edge; both keep the winding.
fn bisect(t: Triangle, side: u32) -> Triangle {
  let first = longest_first(t);
  let middle = (first.a + first.b) * 0.5;
  if side == 0u {
    return Triangle(first.a, middle, first.c);
  }
  return Triangle(middle, first.b, first.c);
}
