// Rays and what they meet.

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
  // Index of the primitive, or MISS.
  primitive: u32,
}

const MISS: u32 = 0xffffffffu;
// Stands for infinity; its square is finite.
const FAR: f32 = 1e18;
// Rounding of positions relative to their size. Primitives are grown by it, so that neighbours leave no gap.
const POSITION_TOLERANCE: f32 = 1e-6;
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
fn ray_epsilon(position: vec3f) -> f32 {
  return 4.0 * POSITION_TOLERANCE * max_component(abs(position));
}

#if STATISTICS
var<private> nodes_visited: u32;
var<private> primitives_tested: u32;
#endif
