// The holes of an alpha-tested triangle (src/alpha_test).

struct Cutout {
  // Texture coordinates of the three corners.
  a: vec2f,
  b: vec2f,
  c: vec2f,
  // The least alpha that is there; 0 where there are no holes.
  threshold: f32,
  // Which picture, and how it is read: bits 0 to 13 the layer, 14 and 15 what is beyond it along u, 16 and 17 along v, 18 and
  // 19 the channel.
  map: u32,
}

const NO_HOLES: Cutout = Cutout(vec2f(0.0), vec2f(0.0), vec2f(0.0), 0.0, 0u);
