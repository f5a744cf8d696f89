// What a ray meets among the primitives of a bounding volume hierarchy (wgsl/common/bvh_layout.wgsl). Nothing but
// trace_nearest(), trace_any() and normal_of() is called from outside.
//
// With #if TWO_LEVELS the hierarchy is one over instances, each of which leads on to that of its mesh. There the ray is moved to
// the mesh's space: its direction is not normalised, so that distances along it stay what they are, and a box or a triangle of
// one space is as good as one of the other. One stack serves both levels.
//
// With #if ALPHA_TESTED some triangles have holes, which rays pass: the caller's pictures are asked where a triangle would be
// met, and of no other.
//
// The importer declares the textures `nodes` and `triangles`, and with #if ALPHA_TESTED `alpha_maps`.

#needs nodes triangles

#import ray
#import bvh_layout
#if ALPHA_TESTED
#import map_alpha
#endif

// What a ray enters of a node's children.
struct Entered {
  // A bit a child that is a node, and the first one's index.
  inner: u32,
  first_node: u32,
  // Children before the first leaf.
  nodes: u32,
  // Two bits per leaf: those of triangles that there are, and of these those in leaves that the ray enters.
  present: u32,
  triangles: u32,
  first_triangle: u32,
  // Distances at which the ray enters the children, FAR for those that it does not.
  t0: vec4f,
  t1: vec4f,
}

// Four bytes as floats.
fn bytes_of(word: u32) -> vec4f {
  return vec4f((vec4u(word) >> vec4u(0u, 8u, 16u, 24u)) & vec4u(0xffu));
}

// Whether a ray enters four boxes before t_max, and where. `near` and `far` are the planes that it meets first and last, `pad`
// how much either is moved apart.
fn enter4(near: vec3u, far: vec3u, scale: vec3f, shift: vec3f, pad: vec3f, t_max: f32) -> vec4f {
  let first = shift - pad;
  let last = shift + pad;
  let x0 = bytes_of(near.x) * scale.x + first.x;
  let y0 = bytes_of(near.y) * scale.y + first.y;
  let z0 = bytes_of(near.z) * scale.z + first.z;
  let x1 = bytes_of(far.x) * scale.x + last.x;
  let y1 = bytes_of(far.y) * scale.y + last.y;
  let z1 = bytes_of(far.z) * scale.z + last.z;
  let enter = max(max(x0, y0), max(z0, vec4f(0.0)));
  let leave = min(min(x1, y1), z1) * (1.0 + SLAB_TOLERANCE);
  // No later than the ray enters, rounding included, so that of hits at one distance none is missed.
  let entered = enter * (1.0 - SLAB_TOLERANCE);
  return select(vec4f(FAR), entered, entered <= min(leave, vec4f(t_max)));
}

fn bits_of(entered: vec4<bool>) -> u32 {
  let bits = select(vec4u(0u), vec4u(1u, 2u, 4u, 8u), entered);
  return (bits.x | bits.y) | (bits.z | bits.w);
}

// Every bit of eight twice.
fn twice(bits: u32) -> u32 {
  var x = (bits | (bits << 4u)) & 0x0f0fu;
  x = (x | (x << 2u)) & 0x3333u;
  return ((x | (x << 1u)) & 0x5555u) * 3u;
}

fn visit_node(ray: Ray, node: u32, t_max: f32) -> Entered {
#if STATISTICS
  nodes_visited++;
#endif
  let at = node_texel_at(node);
  let head = textureLoad(nodes, at, 0);
  let links = textureLoad(nodes, at + vec2u(1u, 0u), 0);
  let a = textureLoad(nodes, at + vec2u(2u, 0u), 0);
  let b = textureLoad(nodes, at + vec2u(3u, 0u), 0);
  let c = textureLoad(nodes, at + vec2u(4u, 0u), 0);
  let step = bitcast<vec3f>(((vec3u(head.w) >> vec3u(0u, 8u, 16u)) & vec3u(0xffu)) << vec3u(23u));
  let scale = step * ray.inverse;
  let shift = (bitcast<vec3f>(head.xyz) - ray.origin) * ray.inverse;
#if TWO_LEVELS
  // Boxes of a mesh are grown by the rounding of its own vertices alone.
  let pad = POSITION_TOLERANCE * ray.reach * abs(ray.inverse);
#else
  let pad = vec3f(0.0);
#endif
  let backwards = ray.inverse < vec3f(0.0);
  let low0 = vec3u(a.x, a.z, b.x);
  let low1 = vec3u(a.y, a.w, b.y);
  let high0 = vec3u(b.z, c.x, c.z);
  let high1 = vec3u(b.w, c.y, c.w);
  let t0 = enter4(select(low0, high0, backwards), select(high0, low0, backwards), scale, shift, pad, t_max);
  let t1 = enter4(select(low1, high1, backwards), select(high1, low1, backwards), scale, shift, pad, t_max);
  let inner = (head.w >> 24u) & 15u;
  let size = inner + (head.w >> 28u);
  let bits = (bits_of(t0 < vec4f(FAR)) | (bits_of(t1 < vec4f(FAR)) << 4u)) & ((1u << size) - 1u);
  return Entered(bits & ((1u << inner) - 1u), links.x, inner, links.z, twice(bits >> inner) & links.z, links.y, t0, t1);
}

#if TWO_LEVELS
// Rounding of what moves a ray to another space, relative to its reach: that of the matrix, of the origin's difference and of
// their product, some 2^-24 each.
const SPACE_TOLERANCE: f32 = 5e-7;

// What the rows of an instance's matrix make of a vector, which is one of the scene.
struct Rows {
  x: vec3f,
  y: vec3f,
  z: vec3f,
}

fn rows_of(instance: u32) -> Rows {
  let at = node_texel_at(instance);
  return Rows(
    bitcast<vec3f>(textureLoad(nodes, at + vec2u(1u, 0u), 0).xyz),
    bitcast<vec3f>(textureLoad(nodes, at + vec2u(2u, 0u), 0).xyz),
    bitcast<vec3f>(textureLoad(nodes, at + vec2u(3u, 0u), 0).xyz),
  );
}

fn apply(rows: Rows, v: vec3f) -> vec3f {
  return vec3f(dot(rows.x, v), dot(rows.y, v), dot(rows.z, v));
}

// A ray in the space of an instance's mesh, whose origin is at `shift`.
fn ray_within(ray: Ray, rows: Rows, shift: vec3f) -> Ray {
  var within = make_ray(apply(rows, ray.origin - shift), apply(rows, ray.direction));
  let sizes = Rows(abs(rows.x), abs(rows.y), abs(rows.z));
  within.reach = apply(sizes, abs(ray.origin) + abs(shift));
#if SHADOW_RAYS
  within.end_size = ray.end_size;
  within.end_reach = apply(sizes, vec3f(ray.end_size));
#endif
  return within;
}

// Along the normal of the triangle that was hit, in the scene's space: its front is where the mesh's is, mirrored or not.
fn normal_of(hit: Hit) -> vec3f {
  let at = triangle_texel_at(hit.triangle);
  let e1 = bitcast<vec3f>(textureLoad(triangles, at + vec2u(1u, 0u), 0).xyz);
  let e2 = bitcast<vec3f>(textureLoad(triangles, at + vec2u(2u, 0u), 0).xyz);
  // Products of edges would underflow below 1e-19.
  let scale = max(max_component(abs(e1)), max_component(abs(e2)));
  let normal = normalize_or(cross(e1 / scale, e2 / scale), vec3f(0.0));
  let rows = rows_of(hit.instance);
  return rows.x * normal.x + rows.y * normal.y + rows.z * normal.z;
}

fn material_of(hit: Hit) -> u32 {
  return textureLoad(nodes, node_texel_at(hit.instance) + vec2u(2u, 0u), 0).w;
}
#endif

// Where a ray meets a triangle, from either side; FAR where it does not (Moeller and Trumbore 1997). Sets the primitive.
fn intersect_triangle(ray: Ray, triangle: u32) -> Hit {
#if STATISTICS
  primitives_tested++;
#endif
  let at = triangle_texel_at(triangle);
  let corner = textureLoad(triangles, at, 0);
  let first = bitcast<vec4f>(textureLoad(triangles, at + vec2u(1u, 0u), 0));
  let second = bitcast<vec4f>(textureLoad(triangles, at + vec2u(2u, 0u), 0));
  let e1 = first.xyz;
  let e2 = second.xyz;
  let p = cross(ray.direction, e2);
  let det = dot(e1, p);
  let s = ray.origin - bitcast<vec3f>(corner.xyz);
  let q = cross(s, e1);
  let per_det = 1.0 / det;
  let u = dot(s, p) * per_det;
  let v = dot(ray.direction, q) * per_det;
  let ahead = dot(e2, q) * per_det;
  var t = ahead;
#if TWO_LEVELS
  // The same by axis: they may have scales that differ by decades.
  let reach = ray.reach + abs(bitcast<vec3f>(corner.xyz));
  let rounding = POSITION_TOLERANCE * abs(per_det) * reach;
  let slack_u = dot(rounding, abs(p));
  let slack_v = dot(rounding, abs(cross(e1, ray.direction)));
  let slack = slack_u + slack_v;
  let across = abs(cross(e1, e2));
  // A triangle whose plane is as near to where the ray starts as that was rounded is not met: it may have started beyond it.
  let least = SPACE_TOLERANCE * abs(per_det) * dot(ray.reach, across);
#else
  let reach = second.w + max_component(abs(ray.origin));
  // Moving the ray sideways by the rounding of positions moves u and v by this much.
  let slack = reach * first.w * abs(per_det);
  let slack_u = slack;
  let slack_v = slack;
  let least = 0.0;
#endif
#if SHADOW_RAYS
  // What a light lies on casts no shadow: a triangle whose plane is as near to the light as positions are rounded. The
  // steeper the ray meets the plane the less it lengthens the way; a vector is at most sqrt(3) times its largest component.
  if ray.end_size >= 0.0 {
#if TWO_LEVELS
    t += POSITION_TOLERANCE * abs(per_det) * dot(reach + ray.end_reach, across);
#else
    t += POSITION_TOLERANCE * (reach + ray.end_size) * 1.7320508 * max_component(abs(cross(e1, e2))) * abs(per_det);
#endif
  }
#endif
  // A ray within the triangle's plane passes it by; so does one whose figures left the range of f32.
  let inside = u >= -slack_u && v >= -slack_v && u + v <= 1.0 + slack && ahead > least && abs(det) > 1e-35;
#if ALPHA_TESTED
  var hit = hit_of(select(FAR, t, inside), corner.w & ~HAS_HOLES);
  hit.triangle = triangle;
  hit.has_holes = (corner.w & HAS_HOLES) != 0u;
  hit.place = vec2f(u, v);
#else
  var hit = hit_of(select(FAR, t, inside), corner.w);
#if TWO_LEVELS
  hit.triangle = triangle;
#endif
#endif
  return hit;
}

#if ALPHA_TESTED
// Whether a triangle is there, where it would be met.
fn is_there(hit: Hit) -> bool {
  if !hit.has_holes {
    return true;
  }
  let at = triangle_texel_at(hit.triangle);
  let first = bitcast<vec4f>(textureLoad(triangles, at + vec2u(3u, 0u), 0));
  let last = textureLoad(triangles, at + vec2u(4u, 0u), 0);
  let a = first.xy;
  let uv = a + (first.zw - a) * hit.place.x + (bitcast<vec2f>(last.xy) - a) * hit.place.y;
  return alpha_at(uv, last.w) >= bitcast<f32>(last.z);
}
#endif

#if TWO_LEVELS
// The root of an instance's mesh.
fn root_of(instance: u32) -> u32 {
#if STATISTICS
  nodes_visited++;
#endif
  return textureLoad(nodes, node_texel_at(instance) + vec2u(1u, 0u), 0).w;
}
#endif

fn triangle_of(entered: Entered, bit: u32) -> u32 {
  return entered.first_triangle + countOneBits(entered.present & ((1u << bit) - 1u));
}

// A bit per triangle whose leaf the ray enters no later than at t.
fn triangles_before(entered: Entered, t: f32) -> u32 {
  let before = bits_of(entered.t0 <= vec4f(t)) | (bits_of(entered.t1 <= vec4f(t)) << 4u);
  return twice(before >> entered.nodes);
}

// Where the ray meets a triangle closer than t_max, which need not be the nearest one, or FAR where it meets none. Of a node's
// children it goes first into those that are most likely to stop it.
fn trace_any(ray: Ray, t_max: f32) -> f32 {
  // Of eight successive nodes those that are to be visited: bits 0 to 7, and from bit 8 on the first one's index.
  var stack: array<u32, STACK_SIZE>;
  var top = 0u;
  var open = 1u;
  var entered: Entered;
  var found = FAR;
  // The ray in the space of what is visited.
  var own = ray;
#if TWO_LEVELS
  var above = true;
  var floor = 0u;
#endif
  loop {
    // Down to the next leaves.
    while entered.triangles == 0u && (open & 0xffu) != 0u {
      var node = (open >> 8u) + firstTrailingBit(open);
      open &= open - 1u;
#if TWO_LEVELS
      if above {
        own = ray;
        let head = textureLoad(nodes, node_texel_at(node), 0);
        if head.w == IS_INSTANCE {
          own = ray_within(ray, rows_of(node), bitcast<vec3f>(head.xyz));
          if (open & 0xffu) != 0u {
            stack[top] = open;
            top++;
          }
          open = 0u;
          // What is on the stack from here on is of the mesh.
          above = false;
          floor = top;
          node = root_of(node);
        }
      }
#endif
      entered = visit_node(own, node, t_max);
      if entered.inner != 0u {
        if (open & 0xffu) != 0u {
          stack[top] = open;
          top++;
        }
        open = (entered.first_node << 8u) | entered.inner;
      } else if (open & 0xffu) == 0u && top > 0u {
        top--;
        open = stack[top];
#if TWO_LEVELS
        above = above || top < floor;
#endif
      }
    }
    if entered.triangles == 0u {
      break;
    }
    while entered.triangles != 0u && found == FAR {
      let hit = intersect_triangle(own, triangle_of(entered, firstTrailingBit(entered.triangles)));
      entered.triangles &= entered.triangles - 1u;
#if ALPHA_TESTED
      if hit.t < t_max && is_there(hit) {
        found = hit.t;
      }
#else
      found = select(FAR, hit.t, hit.t < t_max);
#endif
    }
    if found < FAR {
      break;
    }
  }
  return found;
}

// A distance in ten bits that is not larger and has its order: 5 bits after the first and an exponent of 2^-16 to 2^15, which
// is for scenes of any usual unit; beyond it a bound says less, but nothing wrong.
const LEAST_DISTANCE: u32 = (127u - 16u) << 5u;

fn distance_bits(bits: vec4u) -> vec4u {
  return min(max(bits >> vec4u(18u), vec4u(LEAST_DISTANCE)) - LEAST_DISTANCE, vec4u(1023u));
}

fn distance_of(bits: u32) -> f32 {
  return select(bitcast<f32>((bits + LEAST_DISTANCE) << 18u), 0.0, bits == 0u);
}

// The children that a ray enters, in the order in which it does: three bits each from the lowest on, and above them eight bits
// of the fourth one's distance; and bounds of the first three's distances, ten bits each.
fn order_of(entered: Entered) -> vec2u {
  let is_0 = (vec4u(entered.inner) & vec4u(1u, 2u, 4u, 8u)) != vec4u(0u);
  let is_1 = (vec4u(entered.inner) & vec4u(16u, 32u, 64u, 128u)) != vec4u(0u);
  // Bits of floats that are not negative have the floats' order.
  let keys0 = (bitcast<vec4u>(entered.t0) & vec4u(~7u)) | vec4u(0u, 1u, 2u, 3u);
  let keys1 = (bitcast<vec4u>(entered.t1) & vec4u(~7u)) | vec4u(4u, 5u, 6u, 7u);
  var a = select(vec4u(0xffffffffu), keys0, is_0);
  var b = select(vec4u(0xffffffffu), keys1, is_1);
  // A network of 19 comparisons.
  a = vec4u(min(a.xy, a.zw), max(a.xy, a.zw));
  b = vec4u(min(b.xy, b.zw), max(b.xy, b.zw));
  let least = min(a, b);
  b = max(a, b);
  a = least;
  a = vec4u(min(a.xz, a.yw), max(a.xz, a.yw)).xzyw;
  b = vec4u(min(b.xz, b.yw), max(b.xz, b.yw)).xzyw;
  let least_middle = min(a.zw, b.xy);
  b = vec4u(max(a.zw, b.xy), b.zw);
  a = vec4u(a.xy, least_middle);
  let least_odd = min(a.yw, b.xz);
  let most_odd = max(a.yw, b.xz);
  a = vec4u(a.x, least_odd.x, a.z, least_odd.y);
  b = vec4u(most_odd.x, b.y, most_odd.y, b.w);
  let left = vec3u(a.yw, b.y);
  let right = vec3u(a.z, b.xz);
  let low = min(left, right);
  let high = max(left, right);
  let bounds = (distance_bits(vec4u(a.x, low.x, high.x, low.y)) >> vec4u(0u, 0u, 0u, 2u)) << vec4u(0u, 10u, 20u, 24u);
  let first = (vec4u(a.x, low.x, high.x, low.y) & vec4u(7u)) << vec4u(0u, 3u, 6u, 9u);
  let last = (vec4u(high.y, low.z, high.z, b.w) & vec4u(7u)) << vec4u(12u, 15u, 18u, 21u);
  let order = first | last;
  return vec2u((order.x | order.y) | (order.z | order.w) | bounds.w, bounds.x | bounds.y | bounds.z);
}

// The nearest hit closer than t_max; of two at the same distance that of the primitive with the lower index, and of two
// instances that whose node comes first.
fn trace_nearest(ray: Ray, t_max: f32) -> Hit {
  // Of eight successive nodes those that are to be visited: how many in bits 0 to 7, and from bit 8 on the first one's index;
  // and their order and bounds.
  var stack: array<vec3u, STACK_SIZE>;
  var top = 0u;
  var open = vec3u(1u, 0u, 0u);
  var entered: Entered;
  var best = hit_of(t_max, MISS);
  // The ray in the space of what is visited.
  var own = ray;
#if TWO_LEVELS
  var instance = MISS;
  var above = true;
  var floor = 0u;
#endif
  loop {
    // Down to the next leaves.
    while entered.triangles == 0u && (open.x & 0xffu) != 0u {
      var node = (open.x >> 8u) + (open.y & 7u);
      let is_near = distance_of(open.z & 0x3ffu) <= best.t;
      // The fourth one's bound is one of those after it too.
      let fourth = open.y & 0xff000000u;
      open = vec3u(open.x - 1u, ((open.y & 0xffffffu) >> 3u) | fourth, (open.z >> 10u) | ((fourth >> 24u) << 22u));
      if is_near {
#if TWO_LEVELS
        if above {
          own = ray;
          let head = textureLoad(nodes, node_texel_at(node), 0);
          if head.w == IS_INSTANCE {
            own = ray_within(ray, rows_of(node), bitcast<vec3f>(head.xyz));
            if (open.x & 0xffu) != 0u {
              stack[top] = open;
              top++;
            }
            open = vec3u(0u);
            // What is on the stack from here on is of the mesh.
            above = false;
            floor = top;
            instance = node;
            node = root_of(node);
          }
        }
#endif
        entered = visit_node(own, node, best.t);
      } else {
        // Nor are those that are entered after it.
        entered.inner = 0u;
        open.x &= ~0xffu;
      }
      if entered.inner != 0u {
        if (open.x & 0xffu) != 0u {
          stack[top] = open;
          top++;
        }
        open = vec3u((entered.first_node << 8u) | countOneBits(entered.inner), order_of(entered));
      } else if (open.x & 0xffu) == 0u && top > 0u {
        top--;
        open = stack[top];
#if TWO_LEVELS
        above = above || top < floor;
#endif
      }
    }
    if entered.triangles == 0u {
      break;
    }
    while entered.triangles != 0u {
      var hit = intersect_triangle(own, triangle_of(entered, firstTrailingBit(entered.triangles)));
      entered.triangles &= entered.triangles - 1u;
#if TWO_LEVELS
      hit.instance = instance;
      let is_lower = instance < best.instance || (instance == best.instance && hit.primitive < best.primitive);
#else
      let is_lower = hit.primitive < best.primitive;
#endif
      // Nothing has been hit yet at t_max itself.
      let before = hit.t == best.t && is_lower && best.primitive != MISS;
#if ALPHA_TESTED
      if (hit.t < best.t || before) && is_there(hit) {
        best = hit;
        entered.triangles &= triangles_before(entered, best.t);
      }
#else
      if hit.t < best.t || before {
        best = hit;
        entered.triangles &= triangles_before(entered, best.t);
      }
#endif
    }
  }
  return best;
}
