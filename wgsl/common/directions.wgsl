// Directions of a pixel: one in each cell of a grid over the unit square, which maps to the hemisphere by equal shares
// of the integrand's cosine (or of solid angle).
//
// Within their cells the pixels of a block of 16 x 16 take the points of a (0,2)-sequence in Morton order: the
// directions of each aligned square of 4^k pixels are stratified 4^k times as finely as those of one pixel. Frames scramble
// it anew. Rays of one cell and of neighbouring pixels stay near each other.

const SAMPLE_COSINE: u32 = 0u;
const SAMPLE_UNIFORM: u32 = 1u;

// The most cells.
const CELLS: u32 = 64u;

// Two bits of x and y in turn, from four bits each.
fn morton(p: vec2u) -> u32 {
  var v = p & vec2u(15u);
  v = (v | (v << vec2u(2u))) & vec2u(0x33u);
  v = (v | (v << vec2u(1u))) & vec2u(0x55u);
  return v.x | (v.y << 1u);
}

// The second coordinate of Sobol's (0,2)-sequence, as a fraction of 2^32; the first one is the index's bits reversed.
fn sobol2(index: u32) -> u32 {
  // Row j of the matrix is row j - 1 times x + 1 over the field of two elements.
  var bits = index;
  var column = 0x80000000u;
  var sum = 0u;
  while bits != 0u {
    sum ^= select(0u, column, (bits & 1u) != 0u);
    column ^= column >> 1u;
    bits >>= 1u;
  }
  return sum;
}

// The point of cell `index` of columns x rows, in the unit square.
fn cell_point(pixel: vec2u, index: u32, columns: u32, rows: u32, frame: u32) -> vec2f {
  let block = pixel / 16u;
  let number = morton(pixel);
  // Blocks, cells and frames take the sequence in scrambled digits, which keeps it one of its kind. Frames that went on
  // with it instead would move a pixel's x by less than 1/256: its mean over frames would not converge.
  let key = hash2(block.x | (block.y << 16u), index + CELLS * frame);
  let x = unit_float(reverseBits(number) ^ key);
  let y = unit_float(sobol2(number) ^ hash(key));
  return vec2f((f32(index % columns) + x) / f32(columns), (f32(index / columns) + y) / f32(rows));
}

// The unit square to the unit disk by equal areas, squares about the centre to circles (Shirley and Chiu 1997): the point, and
// the square of its distance from the centre. Of the point's own length little is sure beyond what a driver's sines are: near
// the rim their error would be all there is of 1 - r2.
fn concentric_disk(square: vec2f) -> vec3f {
  let p = 2.0 * square - 1.0;
  if all(p == vec2f(0.0)) {
    return vec3f(0.0);
  }
  let wide = abs(p.x) > abs(p.y);
  let radius = select(p.y, p.x, wide);
  let angle = select(PI / 2.0 - (PI / 4.0) * (p.x / p.y), (PI / 4.0) * (p.y / p.x), wide);
  return vec3f(radius * vec2f(cos(angle), sin(angle)), radius * radius);
}

struct Direction {
  direction: vec3f,
  // Density over solid angle with which it was drawn.
  pdf: f32,
}

// About a unit normal.
fn hemisphere_direction(point: vec2f, normal: vec3f, sampling: u32) -> Direction {
  let disk = concentric_disk(point);
  let r2 = disk.z;
  if sampling == SAMPLE_UNIFORM {
    // Equal areas of the disk to equal areas of the hemisphere: the height falls linearly.
    let height = 1.0 - r2;
    let d = vec3f(disk.xy * sqrt(max(2.0 - r2, 0.0)), height);
    return Direction(tangent_frame(normal) * d, 0.5 / PI);
  }
  let height = sqrt(max(1.0 - r2, 0.0));
  return Direction(tangent_frame(normal) * vec3f(disk.xy, height), height / PI);
}
