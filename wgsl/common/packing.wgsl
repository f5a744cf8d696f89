// Unit vectors as octahedral coordinates in two snorm16 (Cigolle et al. 2014).

fn sign_not_zero(v: vec2f) -> vec2f {
  return select(vec2f(-1.0), vec2f(1.0), v >= vec2f(0.0));
}

fn octahedral_from(n: vec3f) -> vec2f {
  let p = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
  return select((vec2f(1.0) - abs(p.yx)) * sign_not_zero(p), p, n.z >= 0.0);
}

// Not normalised: the caller knows whether it needs to be.
fn octahedral_to(e: vec2f) -> vec3f {
  let z = 1.0 - abs(e.x) - abs(e.y);
  let folded = (vec2f(1.0) - abs(e.yx)) * sign_not_zero(e);
  return vec3f(select(folded, e, z >= 0.0), z);
}

fn pack_normal(n: vec3f) -> u32 {
  return pack2x16snorm(octahedral_from(n));
}

fn unpack_normal(bits: u32) -> vec3f {
  return normalize(octahedral_to(unpack2x16snorm(bits)));
}
