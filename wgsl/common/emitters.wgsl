// Rays towards a cloud's pieces that shine of themselves, drawn in proportion to their power (wgsl/emitters.wgsl). Needs math,
// hashing, surfel, material, triangle and directions.

#needs emitters pieces materials trace_nearest

// Texels of a row (src/emitters/mod.rs).
const EMITTERS_A_ROW: u32 = 4096u;
// No ray has this index: points of emitters are strewn apart from those of rays.
const EMITTERS_KEY: u32 = 64u;
// The most that a distance counts, in sizes of a piece, and the least of its projected area over the square of its size.
const MOST_SIZES: f32 = 1e12;
const LEAST_SEEN: f32 = 1e-10;
// How far a place on a neighbouring piece may be off the one that was aimed at, as a share of the distance.
const AIM: f32 = 2e-5;
// How often the rounding of a ray's place counts: that of the drawn point, and of what is met on either side of an edge.
const EDGE: f32 = 4.0;

// The weights of all pieces before this one. Behind the last piece it is that of all.
fn weight_before(piece: u32) -> u32 {
  return textureLoad(emitters, vec2u(piece % EMITTERS_A_ROW, piece / EMITTERS_A_ROW), 0).x;
}

fn emitters_room() -> u32 {
  let size = textureDimensions(emitters);
  return size.x * size.y;
}

struct EmitterSample {
  point: vec3f,
  piece: u32,
  // Of all weights that of the piece; 0 where nothing shines.
  share: f32,
  // The least of the point's three barycentric coordinates.
  inside: f32,
}

// What share of the rays towards emitters goes to a piece.
fn emitter_share(piece: u32) -> f32 {
  let all = weight_before(emitters_room() - 1u);
  return f32(weight_before(piece + 1u) - weight_before(piece)) / max(f32(all), 1.0);
}

// One of a pixel's `count` points on emitters: each has a share of its own of what picks the piece, so that pieces have as many
// as their weights say, or one more. What picks the piece then says where in it.
fn emitter_sample(pixel: vec2u, index: u32, count: u32, turn: u32, frame: u32) -> EmitterSample {
  let room = emitters_room();
  let all = weight_before(room - 1u);
  if all == 0u {
    return EmitterSample(vec3f(0.0), 0u, 0.0, 0.0);
  }
  let within = point_within(pixel, EMITTERS_KEY, turn, frame);
  let step = 0xffffffffu / count;
  let pick = multiply_high(index * step + multiply_high(within.y, step), all);
  // The last piece that begins at the pick or before it: pieces without weight end there too.
  var low = 0u;
  var high = room - 1u;
  while low + 1u < high {
    let middle = (low + high) / 2u;
    if weight_before(middle) <= pick {
      low = middle;
    } else {
      high = middle;
    }
  }
  let begin = weight_before(low);
  let weight = weight_before(low + 1u) - begin;
  let x = unit_float(within.x + index * GOLDEN_STEP);
  let y = (f32(pick - begin) + 0.5) / f32(weight);
  let piece = pieces[low];
  let across = sqrt(x);
  let u = across * (1.0 - y);
  let v = across * y;
  let point = piece.a + (piece.b - piece.a) * u + (piece.c - piece.a) * v;
  return EmitterSample(point, low, f32(weight) / f32(all), min(min(u, v), 1.0 - across));
}

// Density over solid angle with which a point of a piece is drawn, as seen from so far away along a unit vector.
fn emitter_pdf(share: f32, area: AreaVector, direction: vec3f, distance: f32) -> f32 {
  let sizes = min(distance / max(area.scale, 1e-30), MOST_SIZES);
  return share * sizes * sizes / max(0.5 * abs(dot(area.direction, direction)), LEAST_SEEN);
}

// Of what a surface shines, the share that rays count which come there by chance: the balance heuristic (Veach and Guibas 1995).
// Densities are those of all of a receiver's rays of a kind; those towards emitters count the rest.
fn chance_share(by_chance: f32, aimed: f32) -> f32 {
  return by_chance / max(by_chance + aimed, 1e-30);
}

// Whether rounding may take a ray past the drawn point's piece: the point is that near to an edge, as the ray sees the piece.
fn is_at_edge(ray: Ray, drawn: EmitterSample) -> bool {
  let piece = pieces[drawn.piece];
  let area = area_vector(Triangle(piece.a, piece.b, piece.c));
  let reach = max_component(abs(ray.origin)) + max_component(abs(drawn.point));
  // A point that moves sideways by the rounding of positions moves its coordinates by that over the height that is seen.
  let rounding = EDGE * POSITION_TOLERANCE * reach;
  return drawn.inside * area.scale * abs(dot(area.direction, ray.direction)) <= rounding;
}

// The piece that a ray meets where it was aimed at, which at an edge may be a neighbour of the sample's; MISS where something
// else stands before it. Emitters that lie in one another count once, as what rays meet first; so does the front of a thin
// lamp, which is met right before its back.
fn aim(ray: Ray, drawn: EmitterSample, distance: f32, farthest: f32) -> u32 {
  if all(own_along(drawn.piece, ray.direction) == vec3f(0.0)) {
    return MISS;
  }
  // Near a piece's plane its hits are farther off than AIM, but are its own.
  let hit = trace_nearest(ray, min(2.0 * distance, farthest));
  let is_near = abs(hit.t - distance) <= AIM * distance;
  let is_there = hit.primitive == drawn.piece || (is_near && is_at_edge(ray, drawn));
  return select(MISS, hit.primitive, is_there);
}

// What a piece sends of its own against a direction.
fn own_along(index: u32, direction: vec3f) -> vec3f {
  let piece = pieces[index];
  let material = materials[min(piece.material, arrayLength(&materials) - 1u)];
  let facing = dot(area_vector(Triangle(piece.a, piece.b, piece.c)).direction, direction) < 0.0;
  return own_radiosity(material, facing) / PI;
}

// The density with which a place on a piece is drawn by `count` rays.
fn aimed_pdf(count: u32, index: u32, share: f32, direction: vec3f, distance: f32) -> f32 {
  let piece = pieces[index];
  return f32(count) * emitter_pdf(share, area_vector(Triangle(piece.a, piece.b, piece.c)), direction, distance);
}
