// Segments of a tile: pixels of one surface (Meder and Bruederlin 2018, section 3 and algorithm 1).
//
// A workgroup takes a tile of 32 x 32 texels, each of which stands for one pixel or, where the picture is finer than the
// grid, for a square of them. A texel is segmented by its middle pixel, and the others are read once: they join it if they
// are one surface with it, and are listed otherwise. Those listed join the segment of a texel beside them that they are one
// surface with. Those that find none are segmented in a further round, each texel by the nearest of its own, so that what
// is thinner than a texel is a segment like any other. What the last round finds is one segment whatever it is: no pixel
// has none.
//
// @group(0) @binding(0) params, 1 receivers, 2 the segment of each pixel, 3 segments, 4 counters, 5 the lists

#import sg_hull

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var receivers: texture_2d<u32>;
@group(0) @binding(2) var<storage, read_write> segment_of: array<u32>;
@group(0) @binding(3) var<storage, read_write> segments: array<Segment>;
@group(0) @binding(4) var<storage, read_write> counters: AtomicCounters;
// As many as pixels, a tile's from one place on: the texel in the tile, 10 bits, and the offset from its first pixel, 8 bits
// a coordinate.
@group(0) @binding(5) var<storage, read_write> others: array<u32>;

// The first of Counters.
struct AtomicCounters {
  segments: atomic<u32>,
  fallbacks: atomic<u32>,
  fallback_pixels: atomic<u32>,
}

// Whether components are those of the four sweeps of algorithm 1, or exact ones.
override PROPAGATE: bool = false;

const TILE: u32 = 32u;
const TEXELS: u32 = 1024u;
const THREADS: u32 = 256u;
const PER_THREAD: u32 = 4u;
// Segments of a tile and round; more wait for the next.
const SLOTS: u32 = 128u;
// The last one is the last resort.
const ROUNDS: u32 = 5u;

// A texel's pick, all in one word: the pixel as an offset from the texel's first, 8 bits a coordinate; whether there is
// one, and whether it is linked to the texel on the right and below; the segment's number in the upper 8 bits.
const PICKED: u32 = 0x10000u;
const RIGHT: u32 = 0x20000u;
const BELOW: u32 = 0x40000u;
const NONE: u32 = 0xffu;
const NO_LABEL: u32 = 0xffffffffu;
// Normals are summed as integers: the sum has no order.
const NORMAL_ONE: f32 = 1048576.0;

var<workgroup> labels: array<atomic<u32>, TEXELS>;
var<workgroup> picks: array<u32, TEXELS>;
// Least x, y and depth, largest x, y and depth.
var<workgroup> boxes: array<atomic<u32>, 768>;
var<workgroup> normals: array<atomic<i32>, 384>;
// Texels whose mean normals are summed.
var<workgroup> members: array<atomic<u32>, SLOTS>;
var<workgroup> anchors: array<atomic<u32>, SLOTS>;
// One bit per texel: whether its label stands for a component.
var<workgroup> roots: array<atomic<u32>, 32>;
// One bit per texel: whether it is linked to the one on its right.
var<workgroup> rows: array<u32, 32>;
// Components before those of a word of roots.
var<workgroup> before: array<u32, 32>;
// Pixels of the list, and those of them without a segment.
var<workgroup> listed: atomic<u32>;
var<workgroup> unassigned: atomic<u32>;
var<workgroup> list_length: u32;
var<workgroup> rest: u32;
var<workgroup> first: u32;
var<workgroup> room: u32;

// Unsigned integers in the order of the floats.
fn ordered(x: f32) -> u32 {
  let bits = bitcast<u32>(x);
  return select(bits | 0x80000000u, ~bits, bits >= 0x80000000u);
}

fn unordered(bits: u32) -> f32 {
  return bitcast<f32>(select(~bits, bits & 0x7fffffffu, bits >= 0x80000000u));
}

fn load(pixel: vec2u) -> vec4u {
  return textureLoad(receivers, pixel, 0);
}

fn texel_at(tile: vec2u, t: u32) -> vec2u {
  return tile * TILE + vec2u(t % TILE, t / TILE);
}

// The first pixel of a texel; the first of the next is one past its last.
fn first_pixel(texel: vec2u) -> vec2u {
  return min(texel * params.texel, params.camera.viewport.zw);
}

fn offset_of(bits: u32) -> vec2u {
  return vec2u(bits & 255u, (bits >> 8u) & 255u);
}

fn is_picked(t: u32) -> bool {
  return (picks[t] & PICKED) != 0u;
}

// The pixel that stands for a texel.
fn pick_of(tile: vec2u, t: u32) -> vec2u {
  return first_pixel(texel_at(tile, t)) + offset_of(picks[t]);
}

fn slot_of(t: u32) -> u32 {
  return picks[t] >> 24u;
}

// The component that a label belongs to.
fn root_of(t: u32) -> u32 {
  var root = t;
  var parent = atomicLoad(&labels[root]);
  while parent != root {
    root = parent;
    parent = atomicLoad(&labels[root]);
  }
  return root;
}

// The left end of the run of linked texels that a texel is in.
fn run_start(t: u32) -> u32 {
  let x = t % TILE;
  let ends = ~rows[t / TILE] & ((1u << x) - 1u);
  return t - x + select(firstLeadingBit(ends) + 1u, 0u, ends == 0u);
}

// Whether the texel on the left links the same run to the same run below.
fn follows(t: u32) -> bool {
  let x = t % TILE;
  if x == 0u || (picks[t - 1u] & BELOW) == 0u {
    return false;
  }
  let both = rows[t / TILE] & rows[t / TILE + 1u];
  return ((both >> (x - 1u)) & 1u) != 0u;
}

// Makes two components one: the root with the larger number gets the smaller one as its parent.
fn unite(a: u32, b: u32) {
  var x = root_of(a);
  var y = root_of(b);
  while x != y {
    let low = min(x, y);
    let high = max(x, y);
    let parent = atomicMin(&labels[high], low);
    if parent == high {
      return;
    }
    // Another thread was first: what it hung the root on is to be united too.
    x = root_of(parent);
    y = root_of(low);
  }
}

// One sweep of algorithm 1 along a row or column: a label goes on for as long as texels are linked.
fn sweep(start: u32, stride: u32, link: u32, backward: bool) {
  var label = 0u;
  for (var i = 0u; i < TILE; i++) {
    let t = start + select(i, TILE - 1u - i, backward) * stride;
    var linked = false;
    if i > 0u {
      linked = (picks[select(t - stride, t, backward)] & link) != 0u;
    }
    if linked {
      atomicStore(&labels[t], label);
    } else {
      label = atomicLoad(&labels[t]);
    }
  }
}

fn add_to_box(slot: u32, low: vec2u, high: vec2u, nearest: f32, farthest: f32) {
  let at = slot * 6u;
  atomicMin(&boxes[at], low.x);
  atomicMin(&boxes[at + 1u], low.y);
  atomicMin(&boxes[at + 2u], ordered(nearest));
  atomicMax(&boxes[at + 3u], high.x);
  atomicMax(&boxes[at + 4u], high.y);
  atomicMax(&boxes[at + 5u], ordered(farthest));
}

// Joins a pixel of the list to a segment.
fn join(pixel: vec2u, texel: vec4u, slot: u32, first_slot: u32) {
  segment_of[pixel.y * params.camera.viewport.z + pixel.x] = first_slot + slot;
  let depth = view_depth(params, receiver_position(texel));
  add_to_box(slot, pixel, pixel + 1u, depth, depth);
  atomicSub(&unassigned, 1u);
}

// The segment of a pixel that its own texel does not have: that of a texel beside it with the same surface.
fn slot_beside(tile: vec2u, t: u32, here: Facet, rooms: u32) -> u32 {
  let x = i32(t % TILE);
  let y = i32(t / TILE);
  for (var i = 0; i < 9; i++) {
    let column = x + i % 3 - 1;
    let row = y + i / 3 - 1;
    if i == 4 || column < 0 || row < 0 || column >= i32(TILE) || row >= i32(TILE) {
      continue;
    }
    let other = u32(row) * TILE + u32(column);
    let slot = slot_of(other);
    if slot < rooms && alike(params, here, facet(params, load(pick_of(tile, other)))) {
      return slot;
    }
  }
  return NONE;
}

@compute @workgroup_size(256)
fn segment(@builtin(workgroup_id) tile_id: vec3u, @builtin(local_invocation_index) thread: u32) {
  let tile = tile_id.xy;
  let width = params.camera.viewport.z;
  // The tile's pixels lie in the list as if they were all there were of its rows.
  let tile_low = first_pixel(tile * TILE);
  let tile_high = first_pixel((tile + 1u) * TILE);
  let list_start = tile_low.y * width + tile_low.x * (tile_high.y - tile_low.y);
  if thread == 0u {
    atomicStore(&listed, 0u);
    atomicStore(&unassigned, 0u);
  }
  for (var round = 0u; round < ROUNDS; round++) {
    let last = round == ROUNDS - 1u;
    if thread == 0u {
      list_length = atomicLoad(&listed);
      rest = atomicLoad(&unassigned);
    }
    if thread < 32u {
      atomicStore(&roots[thread], 0u);
    }
    for (var i = thread; i < SLOTS * 6u; i += THREADS) {
      atomicStore(&boxes[i], select(0u, 0xffffffffu, i % 6u < 3u));
    }
    for (var i = thread; i < SLOTS * 3u; i += THREADS) {
      atomicStore(&normals[i], 0);
    }
    if thread < SLOTS {
      atomicStore(&anchors[thread], 0xffffffffu);
      atomicStore(&members[thread], 0u);
    }
    // The pixel that each texel is segmented by: its middle, and then the nearest of those without a segment. A depth is
    // kept to a 128th of it, beside the offset.
    for (var t = thread; t < TEXELS; t += THREADS) {
      let texel = texel_at(tile, t);
      let middle = (first_pixel(texel + 1u) - first_pixel(texel)) / 2u;
      atomicStore(&labels[t], select(NO_LABEL, middle.x | (middle.y << 8u), round == 0u && all(texel < params.grid)));
    }
    let listed_before = workgroupUniformLoad(&list_length);
    for (var i = thread; i < listed_before; i += THREADS) {
      let entry = others[list_start + i];
      let t = entry & 1023u;
      let offset = entry >> 10u;
      let pixel = first_pixel(texel_at(tile, t)) + offset_of(offset);
      if segment_of[pixel.y * width + pixel.x] == UNASSIGNED {
        let depth = view_depth(params, receiver_position(load(pixel)));
        atomicMin(&labels[t], (ordered(depth) & 0xffff0000u) | offset);
      }
    }
    let remaining = workgroupUniformLoad(&rest);
    for (var t = thread; t < TEXELS; t += THREADS) {
      let label = atomicLoad(&labels[t]);
      var pick = NONE << 24u;
      if label != NO_LABEL {
        let offset = label & 0xffffu;
        let is_sky = round == 0u && load(first_pixel(texel_at(tile, t)) + offset_of(offset)).w == SKY;
        pick |= select(PICKED | offset, 0u, is_sky);
      }
      picks[t] = pick;
    }
    workgroupBarrier();

    // Links between neighbours.
    var links = vec4u(0u);
    for (var k = 0u; k < PER_THREAD; k++) {
      let t = thread + k * THREADS;
      if last || !is_picked(t) {
        continue;
      }
      let here = facet(params, load(pick_of(tile, t)));
      // Segments end where quads do.
      let ends = vec2u(t % TILE, t / TILE) % params.quad == vec2u(params.quad - 1u);
      if !ends.x && is_picked(t + 1u) && alike(params, here, facet(params, load(pick_of(tile, t + 1u)))) {
        links[k] = RIGHT;
      }
      if !ends.y && is_picked(t + TILE) && alike(params, here, facet(params, load(pick_of(tile, t + TILE)))) {
        links[k] |= BELOW;
      }
    }
    workgroupBarrier();
    for (var k = 0u; k < PER_THREAD; k++) {
      let t = thread + k * THREADS;
      picks[t] |= links[k];
    }
    workgroupBarrier();
    if thread < TILE {
      var row = 0u;
      for (var x = 0u; x < TILE; x++) {
        row |= select(0u, 1u << x, (picks[thread * TILE + x] & RIGHT) != 0u);
      }
      rows[thread] = row;
    }
    workgroupBarrier();
    // A row's run of linked texels is a component from the start, rooted at its left end.
    for (var k = 0u; k < PER_THREAD; k++) {
      let t = thread + k * THREADS;
      atomicStore(&labels[t], select(select(run_start(t), t, PROPAGATE), 0u, last));
    }
    workgroupBarrier();

    // Components.
    if PROPAGATE {
      if thread < TILE { sweep(thread * TILE, 1u, RIGHT, false); }
      workgroupBarrier();
      if thread < TILE { sweep(thread, TILE, BELOW, false); }
      workgroupBarrier();
      if thread < TILE { sweep(thread * TILE, 1u, RIGHT, true); }
      workgroupBarrier();
      if thread < TILE { sweep(thread, TILE, BELOW, true); }
    } else {
      for (var k = 0u; k < PER_THREAD; k++) {
        let t = thread + k * THREADS;
        if (links[k] & BELOW) != 0u && !follows(t) {
          unite(run_start(t), run_start(t + TILE));
        }
      }
      workgroupBarrier();
      // Runs first, then their texels.
      for (var k = 0u; k < PER_THREAD; k++) {
        let t = thread + k * THREADS;
        if run_start(t) == t {
          atomicStore(&labels[t], root_of(t));
        }
      }
    }
    workgroupBarrier();

    // Their numbers, in the order of their roots.
    var root = vec4u(TEXELS);
    for (var k = 0u; k < PER_THREAD; k++) {
      let t = thread + k * THREADS;
      if is_picked(t) {
        root[k] = atomicLoad(&labels[select(run_start(t), t, PROPAGATE || last)]);
        if root[k] == t || PROPAGATE || last {
          atomicOr(&roots[root[k] / 32u], 1u << (root[k] % 32u));
        }
      }
    }
    workgroupBarrier();
    if thread == 0u {
      var count = 0u;
      for (var i = 0u; i < 32u; i++) {
        before[i] = count;
        count += countOneBits(atomicLoad(&roots[i]));
      }
      count = min(count, SLOTS);
      let limit = first_fallback(params);
      if last {
        first = limit + atomicAdd(&counters.fallbacks, 1u);
        room = 1u;
        atomicAdd(&counters.fallback_pixels, remaining);
      } else {
        first = atomicAdd(&counters.segments, count);
        room = min(count, limit - min(first, limit));
      }
    }
    let rooms = workgroupUniformLoad(&room);
    let first_slot = workgroupUniformLoad(&first);

    for (var k = 0u; k < PER_THREAD; k++) {
      if root[k] < TEXELS {
        let word = root[k] / 32u;
        let rank = before[word] + countOneBits(atomicLoad(&roots[word]) & ((1u << (root[k] % 32u)) - 1u));
        let t = thread + k * THREADS;
        picks[t] = (picks[t] & 0xffffffu) | (min(rank, NONE) << 24u);
      }
    }
    workgroupBarrier();

    // Pixels to the segments of their texels: all of them, and later those of the list.
    for (var k = 0u; k < PER_THREAD; k++) {
      let t = thread + k * THREADS;
      let own = slot_of(t);
      let has_slot = own < rooms;
      let texel = texel_at(tile, t);
      let low = first_pixel(texel);
      let pick = low + offset_of(picks[t]);
      let picked = facet(params, load(pick));
      var normal = picked.normal;
      if round == 0u {
        let high = select(low, first_pixel(texel + 1u), texel < params.grid);
        var box_low = vec2u(0xffffffffu);
        var box_high = vec2u(0u);
        var nearest = MAX_F32;
        var farthest = -MAX_F32;
        var sum = vec3f(0.0);
        var count = 0u;
        for (var y = low.y; y < high.y; y++) {
          for (var x = low.x; x < high.x; x++) {
            let texel_here = load(vec2u(x, y));
            let here = facet(params, texel_here);
            let is_sky = texel_here.w == SKY;
            let joins = !is_sky && has_slot && (all(vec2u(x, y) == pick) || alike(params, here, picked));
            segment_of[y * width + x] = select(select(UNASSIGNED, first_slot + own, joins), SKY_PIXEL, is_sky);
            if joins {
              count++;
              let depth = dot(params.along, here.position);
              box_low = min(box_low, vec2u(x, y));
              box_high = max(box_high, vec2u(x, y) + 1u);
              nearest = min(nearest, depth);
              farthest = max(farthest, depth);
              sum += here.normal;
            } else if !is_sky {
              others[list_start + atomicAdd(&listed, 1u)] = t | ((x - low.x) << 10u) | ((y - low.y) << 18u);
            }
          }
        }
        if has_slot {
          add_to_box(own, box_low, box_high, nearest, farthest);
          normal = sum / f32(count);
        }
      }
      if has_slot {
        // 1024 of them stay within 31 bits.
        let n = vec3i(floor(normal * NORMAL_ONE + 0.5));
        atomicAdd(&members[own], 1u);
        atomicAdd(&normals[own * 3u], n.x);
        atomicAdd(&normals[own * 3u + 1u], n.y);
        atomicAdd(&normals[own * 3u + 2u], n.z);
      }
    }
    for (var i = thread; i < listed_before; i += THREADS) {
      let entry = others[list_start + i];
      let t = entry & 1023u;
      let own = slot_of(t);
      let pixel = first_pixel(texel_at(tile, t)) + offset_of(entry >> 10u);
      if own >= rooms || segment_of[pixel.y * width + pixel.x] != UNASSIGNED {
        continue;
      }
      let here = load(pixel);
      let pick = pick_of(tile, t);
      if last || all(pixel == pick) || similar(params, here, load(pick)) {
        join(pixel, here, own, first_slot);
      }
    }
    storageBarrier();
    workgroupBarrier();
    if thread == 0u {
      list_length = atomicLoad(&listed);
      if round == 0u {
        atomicStore(&unassigned, list_length);
      }
    }
    let listed_now = workgroupUniformLoad(&list_length);

    // The rest to those of texels beside.
    for (var i = thread; i < listed_now; i += THREADS) {
      let entry = others[list_start + i];
      let t = entry & 1023u;
      let offset = entry >> 10u;
      let pixel = first_pixel(texel_at(tile, t)) + offset_of(offset);
      // What a texel is segmented by is never another's: it waits for a round with room.
      let is_pick = is_picked(t) && (picks[t] & 0xffffu) == offset;
      if segment_of[pixel.y * width + pixel.x] != UNASSIGNED || is_pick {
        continue;
      }
      let here = load(pixel);
      let slot = slot_beside(tile, t, facet(params, here), rooms);
      if slot != NONE {
        join(pixel, here, slot, first_slot);
      }
    }
    workgroupBarrier();

    // The picked pixel closest to the middle of each.
    for (var k = 0u; k < PER_THREAD; k++) {
      let t = thread + k * THREADS;
      let slot = slot_of(t);
      if slot < rooms {
        let at = slot * 6u;
        let middle = 0.5 * vec2f(f32(atomicLoad(&boxes[at]) + atomicLoad(&boxes[at + 3u])),
          f32(atomicLoad(&boxes[at + 1u]) + atomicLoad(&boxes[at + 4u])));
        let off = (vec2f(pick_of(tile, t)) + 0.5 - middle) / f32(params.texel);
        atomicMin(&anchors[slot], (min(u32(dot(off, off) * 16.0), 0x3fffffu) << 10u) | t);
      }
    }
    workgroupBarrier();
    if thread < rooms {
      let at = thread * 6u;
      let rect = vec4u(atomicLoad(&boxes[at]), atomicLoad(&boxes[at + 1u]), atomicLoad(&boxes[at + 3u]),
        atomicLoad(&boxes[at + 4u]));
      let anchor = pick_of(tile, atomicLoad(&anchors[thread]) & 1023u);
      let n = vec3f(f32(atomicLoad(&normals[thread * 3u])), f32(atomicLoad(&normals[thread * 3u + 1u])),
        f32(atomicLoad(&normals[thread * 3u + 2u]))) / (NORMAL_ONE * f32(atomicLoad(&members[thread])));
      // Two unit vectors an angle apart have a mean that is short by an eighth of its square; many, by half its mean square.
      let spread = sqrt(2.0 * max(1.0 - length(n) - 1e-6, 0.0));
      segments[first_slot + thread] = Segment(rect, unordered(atomicLoad(&boxes[at + 2u])),
        unordered(atomicLoad(&boxes[at + 5u])), anchor.y * width + anchor.x, pack_normal(normalize_or(n, unpack_normal(load(anchor).w))), spread);
    }
    if thread == 0u {
      rest = atomicLoad(&unassigned);
    }
    storageBarrier();
    let left = workgroupUniformLoad(&rest);
    if left == 0u {
      break;
    }
  }
}
