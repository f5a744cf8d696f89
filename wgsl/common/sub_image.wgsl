// Sub-images at 1, 1/2, 1/4 and 1/8 of the width and height (src/work.rs).

// The pixel of the whole image that a pixel of a sub-image stands for: the one past its middle.
fn stands_for(texel: vec2u, level: u32, size: vec2u) -> vec2u {
  let half = (1u << level) >> 1u;
  return min((texel << vec2u(level)) + half, size - 1u);
}
