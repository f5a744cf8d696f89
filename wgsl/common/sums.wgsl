// What an effect adds up, and how it is kept: planes of up to four channels, one after the other on each level. Needs math.

#if OCTET
alias Sum = mat2x4f;
const PLANES: u32 = 2u;

// A value where it counts, and nothing elsewhere.
fn chosen(value: Sum, counts: bool) -> Sum {
  return Sum(select(vec4f(0.0), value[0], counts), select(vec4f(0.0), value[1], counts));
}

fn is_positive(value: Sum) -> bool {
  return any(value[0] > vec4f(0.0)) || any(value[1] > vec4f(0.0));
}

// Whether an effect's sum can be used: one that overflowed or is NaN counts for nothing, here and in its neighbours.
fn is_usable(sum: Sum) -> bool {
  return is_finite4(sum[0]) && is_finite4(sum[1]);
}

fn texel_of(sum: Sum, plane: u32) -> vec4f {
  return select(sum[0], sum[1], plane == 1u);
}
#else
#if QUAD
alias Sum = vec4f;
#else
#if COLOR
alias Sum = vec3f;
#else
#if PAIR
alias Sum = vec2f;
#else
alias Sum = f32;
#endif
#endif
#endif
const PLANES: u32 = 1u;

// A value where it counts, and nothing elsewhere.
fn chosen(value: Sum, counts: bool) -> Sum {
  return select(Sum(0.0), value, counts);
}

fn is_positive(value: Sum) -> bool {
  return any(value > Sum(0.0));
}

// Whether an effect's sum can be used: one that overflowed or is NaN counts for nothing, here and in its neighbours.
fn is_usable(sum: Sum) -> bool {
#if QUAD
  return is_finite4(sum);
#else
#if COLOR
  return is_finite3(sum);
#else
#if PAIR
  return is_finite(sum.x) && is_finite(sum.y);
#else
  return is_finite(sum);
#endif
#endif
#endif
}

fn texel_of(sum: Sum, plane: u32) -> vec4f {
#if QUAD
  return sum;
#else
#if COLOR
  return vec4f(sum, 0.0);
#else
#if PAIR
  return vec4f(sum, 0.0, 0.0);
#else
  return vec4f(sum, 0.0, 0.0, 0.0);
#endif
#endif
#endif
}
#endif
