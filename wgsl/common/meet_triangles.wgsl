// Rays against runs of four triangles, for wgsl/common/walk.wgsl.
//
// The importer declares the texture `leaves` (wgsl/sender_bounds.wgsl).

#needs leaves

#import walk

fn leaf_texel(i: u32) -> vec4f {
  return textureLoad(leaves, vec2u(i % TEXELS_A_ROW, i / TEXELS_A_ROW), 0);
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
  let ahead = dot4(e2, q) * per_det;
  var t = ahead;
  // Moving the ray sideways by the rounding of positions moves u and v by this much.
  let size = largest4(e1) + largest4(e2);
  let reach = largest4(a) + max_component(abs(ray.origin));
  let slack = POSITION_TOLERANCE * reach * size * abs(per_det);
#if SHADOW_RAYS
  // What a light lies on casts no shadow: a triangle whose plane is as near to the light as positions are rounded. The
  // steeper the ray meets the plane the less it lengthens the way; a vector is at most sqrt(3) times its largest component.
  if ray.end_size >= 0.0 {
    t += POSITION_TOLERANCE * (reach + ray.end_size) * 1.7320508 * largest4(cross4(e1, e2)) * abs(per_det);
  }
#endif
  // A ray within the triangle's plane passes it by; so does one whose figures left the range of f32.
  let inside = (u >= -slack) & (v >= -slack) & (u + v <= 1.0 + slack) & (ahead > vec4f(0.0)) & (abs(det) > vec4f(1e-35));
  return select(vec4f(FAR), t, inside);
}
