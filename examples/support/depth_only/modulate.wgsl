// From what comes in to what goes out again: irradiance / pi times the albedo, after the filter has left edges of the
// albedo alone.

@group(0) @binding(1) var incident: texture_2d<f32>;
@group(0) @binding(2) var albedos: texture_2d<f32>;
@group(0) @binding(3) var result: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn modulate(@builtin(global_invocation_id) id: vec3u) {
  if all(id.xy < params.size) {
    let value = textureLoad(albedos, id.xy, 0).xyz * textureLoad(incident, id.xy, 0).xyz;
    textureStore(result, id.xy, vec4f(value, 1.0));
  }
}
