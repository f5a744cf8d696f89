// Rays and what they meet.

struct Ray {
  origin: vec3f,
  direction: vec3f,
  inverse: vec3f,
#if SHADOW_RAYS
  // The size of the coordinates of the light that it ends at, which may lie on a surface; negative where it ends at none.
  end_size: f32,
#endif
#if TWO_LEVELS
  // In the space of a mesh: how large what the ray's origin was computed of is there, per axis.
  reach: vec3f,
#if SHADOW_RAYS
  // And the coordinates of the light.
  end_reach: vec3f,
#endif
#endif
}

struct Hit {
  t: f32,
  // Index of the primitive, or MISS.
  primitive: u32,
#if TWO_LEVELS
  // The node of its instance, and the triangle.
  instance: u32,
  triangle: u32,
#endif
#if ALPHA_TESTED
#if !TWO_LEVELS
  triangle: u32,
#endif
  // Whether the triangle has holes, and weights of its second and third corner.
  has_holes: bool,
  place: vec2f,
#endif
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
  var ray: Ray;
  ray.origin = origin;
  ray.direction = direction;
  ray.inverse = 1.0 / d;
#if SHADOW_RAYS
  ray.end_size = -1.0;
#endif
  return ray;
}

fn hit_of(t: f32, primitive: u32) -> Hit {
  var hit: Hit;
  hit.t = t;
  hit.primitive = primitive;
  return hit;
}

// How far a ray starts off what it leaves: by more than the rounding of a position.
fn ray_epsilon(position: vec3f) -> f32 {
  return 4.0 * POSITION_TOLERANCE * max_component(abs(position));
}

#if STATISTICS
var<private> nodes_visited: u32;
var<private> primitives_tested: u32;
#endif
