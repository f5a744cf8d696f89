// Interleaved levels (Deep Screen Space 3.2). On level l the image is cut into blocks of 2^l x 2^l pixels, and the
// pixels of each block are dealt to 4^l sub-buffers by a permutation of the block's own. A sub-buffer has one pixel a
// block, at the block's place.

// A permutation of 0 ... 4^level - 1, keyed. Each step is a bijection modulo 2^(2 level): xor, multiplication by an
// odd number, and an xor with the upper half.
fn permute(value: u32, key: u32, level: u32) -> u32 {
  let bits = 2u * level;
  let mask = (1u << bits) - 1u;
  let half = (bits + 1u) / 2u;
  var x = value ^ (key & mask);
  x = (x * (((key >> 5u) << 1u) | 1u)) & mask;
  x ^= x >> half;
  x = (x * (((key >> 13u) << 1u) | 1u)) & mask;
  x ^= x >> half;
  return (x + (key >> 20u)) & mask;
}

fn block_key(block: vec2u, level: u32, seed: u32) -> u32 {
  return hash2(block.x | (block.y << 16u), level + seed * 16u);
}

// The pixel that a block gives to a sub-buffer; it may lie outside of an image whose size is not a multiple of 2^level.
fn pixel_of(block: vec2u, sub_buffer: u32, level: u32, seed: u32) -> vec2u {
  if level == 0u {
    return block;
  }
  let k = permute(sub_buffer, block_key(block, level, seed), level);
  return (block << vec2u(level)) + vec2u(k & ((1u << level) - 1u), k >> level);
}

// The inverse of permute(): its steps undone, last one first.
fn unpermute(value: u32, key: u32, level: u32) -> u32 {
  let bits = 2u * level;
  let mask = (1u << bits) - 1u;
  let half = (bits + 1u) / 2u;
  var x = (value - (key >> 20u)) & mask;
  // An xor with the upper half is its own inverse.
  x ^= x >> half;
  x = (x * inverse_odd(((key >> 13u) << 1u) | 1u)) & mask;
  x ^= x >> half;
  x = (x * inverse_odd(((key >> 5u) << 1u) | 1u)) & mask;
  return x ^ (key & mask);
}

// The number that an odd one multiplies to 1 modulo 2^24. It is its own inverse modulo 8, and each of Newton's steps
// doubles the bits that are right.
fn inverse_odd(a: u32) -> u32 {
  var x = a;
  x *= 2u - a * x;
  x *= 2u - a * x;
  x *= 2u - a * x;
  return x;
}

// The sub-buffer that gets a pixel: the inverse of pixel_of().
fn sub_buffer_of(pixel: vec2u, level: u32, seed: u32) -> u32 {
  if level == 0u {
    return 0u;
  }
  let block = pixel >> vec2u(level);
  let inner = pixel & vec2u((1u << level) - 1u);
  return unpermute(inner.x | (inner.y << level), block_key(block, level, seed), level);
}

// How many surfels of `stored` a sub-buffer has: they are dealt in turn.
fn surfels_dealt(stored: u32, sub_buffer: u32, level: u32) -> u32 {
  if sub_buffer >= stored {
    return 0u;
  }
  return ((stored - sub_buffer - 1u) >> (2u * level)) + 1u;
}

// Which surfel is a sub-buffer's `rank`-th.
fn surfel_dealt(rank: u32, sub_buffer: u32, level: u32) -> u32 {
  return (rank << (2u * level)) + sub_buffer;
}
