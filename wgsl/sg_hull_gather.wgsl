// Light at the hull's vertices that are listed, and at the points of a round of splits.
//
// @group(0) @binding(0) params, 1 counters, 2 the list, 3 vertices, 4 the splits
// @group(1) what the gatherer binds

#import sg_hull
#import dispatch
#import lobes
#import sg_hull_vertex
#import sg_hull_split
#import gatherer

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> counters: Counters;
@group(0) @binding(2) var<storage, read> list: array<Gathering>;
@group(0) @binding(3) var<storage, read_write> vertices: array<HullVertex>;
@group(0) @binding(4) var<storage, read_write> splits: array<Split>;

// What one lobe gets wrong of the irradiance of a surface with the vertex's normal, which is known. Without this a floor
// that light grazes would be lit by what a broad lobe has above the horizon.
fn excess(moments: LightMoments, normal: vec3f, irradiance: f32) -> f32 {
  let scaled = sg_lobe(moments);
  let found = scaled.amplitude * sg_cosine_integral(dot(normal, scaled.lobe.axis), scaled.lobe.sharpness);
  return found - irradiance;
}

@compute @workgroup_size(64)
fn gather_vertices(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let k = linear_workgroup(workgroup) * 64u + thread;
  if k >= counters.gathered {
    return;
  }
  let index = list[k].vertex;
  let n = unpack_normal(list[k].normal);
  let sum = gather(vertices[index].position, n, 0u, 1u);
  let red = usable(sum.red);
  let green = usable(sum.green);
  let blue = usable(sum.blue);
  vertices[index].red = red;
  vertices[index].green = green;
  vertices[index].blue = blue;
  let irradiance = usable_irradiance(sum.irradiance);
  vertices[index].excess = vec3f(excess(red, n, irradiance.x), excess(green, n, irradiance.y),
    excess(blue, n, irradiance.z));
  vertices[index].irradiance = irradiance;
}

@compute @workgroup_size(64)
fn gather_points(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let k = linear_workgroup(workgroup) * 64u + thread;
  let i = counters.round.x + k / SPLIT_POINTS;
  if i >= counters.round.y {
    return;
  }
  let here = splits[i].points[k % SPLIT_POINTS];
  let irradiance = gather(here.position, unpack_normal(here.normal), 0u, 1u).irradiance;
  splits[i].points[k % SPLIT_POINTS].irradiance = usable_irradiance(irradiance);
}
