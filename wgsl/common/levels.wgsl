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

// The pixel that a block gives to a sub-buffer; it may lie outside of an image whose size is not a multiple of 2^level.
fn pixel_of(block: vec2u, sub_buffer: u32, level: u32, seed: u32) -> vec2u {
  if level == 0u {
    return block;
  }
  let key = hash2(block.x | (block.y << 16u), level + seed * 16u);
  let k = permute(sub_buffer, key, level);
  return (block << vec2u(level)) + vec2u(k & ((1u << level) - 1u), k >> level);
}
