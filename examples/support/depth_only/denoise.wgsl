// A plain cross-bilateral mean, along rows and then along columns: neighbours count as far as they lie in the pixel's
// tangent plane and it in theirs, and share its normal. RESULT is the format of what is filtered.

@group(0) @binding(1) var depths: texture_2d<f32>;
@group(0) @binding(2) var normals: texture_2d<f32>;
@group(0) @binding(3) var noisy: texture_2d<f32>;
@group(0) @binding(4) var result: texture_storage_2d<RESULT, write>;

// How far off the plane a neighbour counts no more, pixels.
const PLANE_DISTANCE: f32 = 2.0;

fn filtered(at: vec2i, along: vec2i) -> vec4f {
  let own = textureLoad(noisy, at, 0);
  let depth = textureLoad(depths, at, 0).x;
  if is_sky(depth) {
    return own;
  }
  let p = position(vec2f(at) + 0.5, depth);
  let normal = normalize(textureLoad(normals, at, 0).xyz);
  let per_tolerance = 1.0 / (PLANE_DISTANCE * length(params.right) * depth);
  var sum = own;
  var weights = 1.0;
  for (var i = -params.filter_radius; i <= params.filter_radius; i++) {
    let there = at + i * along;
    if i == 0 || any(there < vec2i(0)) || any(there >= size()) {
      continue;
    }
    let other_depth = textureLoad(depths, there, 0).x;
    if is_sky(other_depth) {
      continue;
    }
    let d = position(vec2f(there) + 0.5, other_depth) - p;
    let other = normalize(textureLoad(normals, there, 0).xyz);
    let off = max(abs(dot(normal, d)), abs(dot(other, d))) * per_tolerance;
    let near = max(1.0 - off * off, 0.0);
    let cosine = max(dot(normal, other), 0.0);
    let cosine2 = cosine * cosine;
    let cosine4 = cosine2 * cosine2;
    let weight = near * near * cosine4 * cosine4;
    sum += weight * textureLoad(noisy, there, 0);
    weights += weight;
  }
  return sum / weights;
}

@compute @workgroup_size(8, 8)
fn rows(@builtin(global_invocation_id) id: vec3u) {
  if all(id.xy < params.size) {
    textureStore(result, id.xy, filtered(vec2i(id.xy), vec2i(1, 0)));
  }
}

@compute @workgroup_size(8, 8)
fn columns(@builtin(global_invocation_id) id: vec3u) {
  if all(id.xy < params.size) {
    textureStore(result, id.xy, filtered(vec2i(id.xy), vec2i(0, 1)));
  }
}
