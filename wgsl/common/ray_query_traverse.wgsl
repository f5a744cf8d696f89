// What a ray meets among a cloud's pieces by the device's own queries: trace_nearest() and trace_any(), as in bvh_traverse. Of
// two hits at the same distance the device takes either.
//
// The importer declares the acceleration structure `scene`, whose triangles are the pieces, and with #if SHADOW_RAYS `pieces`.

#needs scene
#if SHADOW_RAYS
#needs pieces
#endif

#import ray

// Of a ray's flags.
const OPAQUE: u32 = 1u;
const NOT_OPAQUE: u32 = 2u;
const UNTIL_ANY_HIT: u32 = 4u;

const EVERY_INSTANCE: u32 = 0xffu;

// The nearest hit closer than t_max.
fn trace_nearest(ray: Ray, t_max: f32) -> Hit {
  var query: ray_query;
  rayQueryInitialize(&query, scene, RayDesc(OPAQUE, EVERY_INSTANCE, 0.0, t_max, ray.origin, ray.direction));
  while rayQueryProceed(&query) {}
  let found = rayQueryGetCommittedIntersection(&query);
  if found.kind == RAY_QUERY_INTERSECTION_NONE || found.t >= t_max {
    return Hit(t_max, MISS);
  }
  return Hit(found.t, found.primitive_index);
}

#if SHADOW_RAYS
// What a light lies on casts no shadow: how much farther a triangle counts as met, as in bvh_traverse.
fn lengthening(ray: Ray, index: u32) -> f32 {
  let piece = pieces[index];
  let e1 = piece.b - piece.a;
  let e2 = piece.c - piece.a;
  let det = dot(e1, cross(ray.direction, e2));
  let size = max_component(abs(piece.a)) + max_component(abs(ray.origin)) + ray.end_size;
  return POSITION_TOLERANCE * size * 1.7320508 * max_component(abs(cross(e1, e2))) / abs(det);
}
#endif

// Where the ray meets a triangle closer than t_max, which need not be the nearest one, or FAR where it meets none.
fn trace_any(ray: Ray, t_max: f32) -> f32 {
  var flags = OPAQUE | UNTIL_ANY_HIT;
#if SHADOW_RAYS
  // The device shows what such a ray meets, so that some of it can be passed by.
  let ends_at_light = ray.end_size >= 0.0;
  flags = select(flags, NOT_OPAQUE | UNTIL_ANY_HIT, ends_at_light);
#endif
  var query: ray_query;
  rayQueryInitialize(&query, scene, RayDesc(flags, EVERY_INSTANCE, 0.0, t_max, ray.origin, ray.direction));
  while rayQueryProceed(&query) {
#if SHADOW_RAYS
    let met = rayQueryGetCandidateIntersection(&query);
    if met.t + lengthening(ray, met.primitive_index) < t_max {
      rayQueryConfirmIntersection(&query);
    }
#endif
  }
  let found = rayQueryGetCommittedIntersection(&query);
  return select(found.t, FAR, found.kind == RAY_QUERY_INTERSECTION_NONE || found.t >= t_max);
}
