// Directions of a pixel: one in each cell of a grid over the unit square, which maps to the hemisphere by equal shares
// of the integrand's cosine (or of solid angle).
//
// Within their cells the pixels of a block of 16 x 16 take the points of a (0,2)-sequence in Morton order: the
// directions of each aligned square of 4^k pixels are stratified 4^k times as finely as those of one pixel. Over frames a pixel
// takes the points of another one, so that its directions of 2^k frames in a row from a multiple of 2^k are stratified 2^k
// times as finely as those of one frame. Rays of one cell and of neighbouring pixels stay near each other.

const SAMPLE_COSINE: u32 = 0u;
const SAMPLE_UNIFORM: u32 = 1u;

// Two bits of x and y in turn, from four bits each.
fn morton(p: vec2u) -> u32 {
  var v = p & vec2u(15u);
  v = (v | (v << vec2u(2u))) & vec2u(0x33u);
  v = (v | (v << vec2u(1u))) & vec2u(0x55u);
  return v.x | (v.y << 1u);
}

// Of Sobol's (0,2)-sequence the first coordinate is the index's bits reversed, the first one being worth 1/2, and the second
// one this with its bits reversed. Bit j is the sum of the bits k whose binomial coefficient (k, j) is odd, those that have
// all of j's bits: one step for each bit of j.
fn sobol2(index: u32) -> u32 {
  var v = index;
  v ^= (v >> 1u) & 0x55555555u;
  v ^= (v >> 2u) & 0x33333333u;
  v ^= (v >> 4u) & 0x0f0f0f0fu;
  v ^= (v >> 8u) & 0x00ff00ffu;
  return v ^ (v >> 16u);
}

// Owen's scrambling of a number in reversed bits: whether a bit flips depends on the key and the bits below it alone (Laine
// and Karras 2011; the constants are N. Vegdahl's). What is stratified by leading digits stays so.
fn scramble(bits: u32, key: u32) -> u32 {
  var v = bits ^ (bits * 0x3d20adeau);
  v += key;
  v *= (key >> 16u) | 1u;
  v ^= v * 0x05526c56u;
  return v ^ (v * 0x53a22864u);
}

// The point of cell `index` of columns x rows, in the unit square.
fn cell_point(pixel: vec2u, index: u32, columns: u32, rows: u32, frame: u32) -> vec2f {
  let block = pixel / 16u;
  let number = morton(pixel);
  // Frames flip digits of the pixels' sequence, blocks and cells each in their own way. Flips that are the same for all
  // pixels keep it one of its kind; and as they take the points of such a sequence themselves, so do each pixel's over
  // frames. Scrambled, since what pixels and frames have in common would bring the same points again. Frames that went on
  // where the pixels' sequence ends would move a pixel's x by less than 1/256: its mean over them would not converge.
  let key = hash2(block.x | (block.y << 16u), index);
  let x = unit_float(reverseBits(number ^ scramble(frame, key)));
  let y = unit_float(reverseBits(sobol2(number) ^ scramble(sobol2(frame), hash(key))));
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
