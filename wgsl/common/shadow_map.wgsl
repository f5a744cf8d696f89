// A light's shadow map (src/surfel_shader/mod.rs): depth as seen from the light, by one camera or by several. Points are in
// the space that the cameras' parameters are for.
//
// The importer declares `shadow`, a uniform Shadow, and `depth_map`, a texture_2d_array<f32>.

#needs shadow depth_map

struct ShadowCamera {
  // From a position.
  clip: mat4x4f,
  // x, y, width, height in texels.
  viewport: vec4f,
  // Side of a texel, world units for each unit of the clip space's w.
  texel: f32,
  // Along a ray of the camera, depth is depth_scale / distance but for a constant of a perspective one, where distances are
  // the clip space's w times `per_w`; of another a distance is depth_scale * depth but for a constant.
  depth_scale: f32,
  per_w: f32,
  perspective: u32,
  // The depth of the background, 0 or 1.
  far_depth: f32,
  padding: u32,
  // How depth at one distance along the axis changes with ndc.x and ndc.y: 0 but for an oblique near plane.
  tilt: vec2f,
}

struct Shadow {
  cameras: array<ShadowCamera, 6>,
  count: u32,
  // How far a point is moved off its surface, in texels.
  bias: f32,
  // How far a stored depth may lie from the true one.
  depth_step: f32,
  padding: f32,
}

// Whether there is but one map: no other is asked then.
override ONE_MAP: bool = false;

// A share of w: two maps that meet share their edge, whatever the rounding.
const SEAM: f32 = 1e-5;

// A point in the clip space of the first map that knows of it; `layer` is `shadow.count` where none does.
struct Seen {
  layer: u32,
  clip: vec4f,
}

// What a map sees of a point, where none before it did.
fn or_seen(before: Seen, layer: u32, point: vec3f) -> Seen {
  if before.layer < shadow.count || layer >= shadow.count {
    return before;
  }
  let clip = shadow.cameras[layer].clip * vec4f(point, 1.0);
  let bound = clip.w * (1.0 + SEAM);
  let inside = clip.w > 0.0 && all(abs(clip.xy) <= vec2f(bound)) && clip.z >= 0.0 && clip.z <= clip.w;
  if !inside {
    return before;
  }
  return Seen(layer, clip);
}

// Written out, so that each camera is at a constant place: a loop's would be fetched for each invocation.
fn first_map(point: vec3f) -> Seen {
  var seen = or_seen(Seen(shadow.count, vec4f(0.0)), 0u, point);
  if !ONE_MAP {
    seen = or_seen(seen, 1u, point);
    seen = or_seen(seen, 2u, point);
    seen = or_seen(seen, 3u, point);
    seen = or_seen(seen, 4u, point);
    seen = or_seen(seen, 5u, point);
  }
  return seen;
}

// What a map says of a point.
struct LookUp {
  // `shadow.count` where no map knows of the point.
  layer: u32,
  // Of the point, and of what the light sees there.
  depth: f32,
  nearest: f32,
  // The clip space's of the point.
  w: f32,
}

// Of a point of a surface; `side` is the normal on the side of the light.
fn look_up(point: vec3f, side: vec3f) -> LookUp {
  let own = first_map(point);
  if own.layer == shadow.count {
    return LookUp(shadow.count, 0.0, 0.0, 1.0);
  }
  // Moved by the same way for all maps: between two of them it could else be in neither.
  let seen = first_map(point + side * (shadow.bias * shadow.cameras[own.layer].texel * own.clip.w));
  if seen.layer == shadow.count {
    return LookUp(shadow.count, 0.0, 0.0, 1.0);
  }
  let ndc = seen.clip.xyz / seen.clip.w;
  let uv = clamp(ndc.xy * vec2f(0.5, -0.5) + 0.5, vec2f(0.0), vec2f(1.0));
  let viewport = shadow.cameras[seen.layer].viewport;
  let texel = min(floor(uv * viewport.zw), viewport.zw - 1.0);
  // The map holds depths at the middles of its texels.
  let middle = (texel + 0.5) / viewport.zw * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
  let depth = ndc.z + dot(shadow.cameras[seen.layer].tilt, middle - ndc.xy);
  return LookUp(seen.layer, depth, textureLoad(depth_map, vec2u(viewport.xy + texel), seen.layer, 0).x, seen.clip.w);
}

// Whether something is nearer to the light.
fn is_hidden(found: LookUp) -> bool {
  if found.layer == shadow.count {
    return false;
  }
  let forward = found.nearest < found.depth - shadow.depth_step;
  let reversed = found.nearest > found.depth + shadow.depth_step;
  return select(forward, reversed, shadow.cameras[found.layer].far_depth == 0.0);
}
