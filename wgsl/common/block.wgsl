// Values of 2 x 2 pixels in one texel of 8 bits each, rows from the top: what edges and masks of sub-images are stored as
// (wgsl/multi_res_mask.wgsl).

// As they go to the texture: what is above 0 stays above 0 in 8 bits.
fn stored(value: vec4f) -> vec4f {
  return select(vec4f(0.0), max(value, vec4f(1.0 / 255.0)), value > vec4f(0.0));
}

// Of the pixel whose block it is.
fn of_block(block: vec4f, pixel: vec2u) -> f32 {
  let row = select(block.xy, block.zw, (pixel.y & 1u) != 0u);
  return select(row.x, row.y, (pixel.x & 1u) != 0u);
}

fn largest_of(block: vec4f) -> f32 {
  return max(max(block.x, block.y), max(block.z, block.w));
}
