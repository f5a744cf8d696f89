// Bounds over a cloud's surfels (wgsl/shell_splatter.wgsl makes them): 16 successive surfels of a sub-buffer are a cluster, 64
// clusters a group.

// Bounds of 16 surfels, or of 64 clusters.
struct Cluster {
  low: vec3f,
  // The farthest that one of them reaches; negative where none does.
  reach: f32,
  high: vec3f,
  // Bounds of the normals, rounded outward to multiples of 1/15: six times 5 bits.
  normals: u32,
}

const CLUSTER: u32 = 16u;
const GROUP: u32 = 64u;

fn divide_up(a: u32, b: u32) -> u32 {
  return (a + b - 1u) / b;
}
