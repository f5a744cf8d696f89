// The depth buffer as depth, once for all passes: a position is then a ray times a number.

@group(0) @binding(1) var depth_buffer: texture_2d<f32>;
@group(0) @binding(2) var depths: texture_storage_2d<r32float, write>;

@compute @workgroup_size(8, 8)
fn linearize(@builtin(global_invocation_id) id: vec3u) {
  if any(id.xy >= params.size) {
    return;
  }
  let value = textureLoad(depth_buffer, id.xy, 0).x;
  var depth = SKY;
  if value != params.far_depth {
    depth = params.depth_scale / (value - params.depth_offset);
  }
  textureStore(depths, id.xy, vec4f(depth, 0.0, 0.0, 0.0));
}
