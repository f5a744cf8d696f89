// Light gathered at every pixel, for comparison and where pixels are few (src/sg_hull).
//
// @group(0) @binding(0) params, 1 receivers, 6 albedo
// @group(1) what the gatherer binds

#import sg_hull
#import lobes
#import gatherer
#import screen

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var receivers: texture_2d<u32>;
#if ALBEDO
@group(0) @binding(6) var albedo_texture: texture_2d<f32>;
#endif

@fragment
fn exact(@builtin(position) fragment: vec4f) -> @location(0) vec4f {
  let pixel = min(vec2u(fragment.xy) - params.camera.viewport.xy, params.camera.viewport.zw - 1u);
  let texel = textureLoad(receivers, pixel, 0);
  if texel.w == SKY {
    return vec4f(0.0, 0.0, 0.0, 1.0);
  }
  let normal = unpack_normal(texel.w);
  let lobes = gather(receiver_position(texel), normal, 0u, 1u);
  var color = lobes.irradiance / PI;
#if ALBEDO
  color *= textureLoad(albedo_texture, params.camera.viewport.xy + pixel, 0).xyz;
#endif
  return vec4f(color, 1.0);
}
