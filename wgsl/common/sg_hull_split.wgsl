// Parts of flat quads that do not fit (src/sg_hull). Needs sg_hull.

// A rectangle of a segment whose pixels have one normal.
struct Part {
  // The first pixel and the one past the last, each x and 65536 y.
  low: u32,
  high: u32,
  slot: u32,
  padding: u32,
  // Irradiance at the corners, and how far along the camera's axis they are.
  corners: array<vec4f, 4>,
}

// A point that light is gathered at.
struct SplitPoint {
  // Relative to the origin of the recording.
  position: vec3f,
  // Packed.
  normal: u32,
  irradiance: vec3f,
  depth: f32,
}

// A part that is split in four, at the middles of its upper, left, right and lower edge and its own, in the order of rows.
struct Split {
  whole: Part,
  points: array<SplitPoint, 5>,
}

const SPLIT_POINTS: u32 = 5u;
// Pixels across from which on a part is split rather than gathered at each of its pixels.
const SPLIT_SIDE: u32 = 4u;

fn can_be_split(low: vec2u, high: vec2u) -> bool {
  return all(high - low >= vec2u(SPLIT_SIDE));
}

// Between a part's first pixel and the one past the last.
fn middle_of(low: vec2u, high: vec2u) -> vec2u {
  return (low + high) / 2u;
}
