// Depth, normal and albedo of the surfaces that kiss3d draws, one sample per pixel.

// As kiss3d multiplies them, so that the pixels are the same.
struct View { view: mat4x4f, projection: mat4x4f, eye: vec4f }

@group(0) @binding(0) var<uniform> view: View;
@group(1) @binding(0) var map: texture_2d<f32>;
@group(1) @binding(1) var map_sampler: sampler;

struct Corner {
  @location(0) position: vec3f,
  @location(1) normal: vec3f,
  @location(2) uv: vec2f,
  // Of the instance: object to world, column by column, and its albedo.
  @location(3) x: vec4f,
  @location(4) y: vec4f,
  @location(5) z: vec4f,
  @location(6) w: vec4f,
  @location(7) albedo: vec4f,
}

struct Vertex {
  @builtin(position) clip: vec4f,
  // From the eye.
  @location(0) relative: vec3f,
  @location(1) normal: vec3f,
  @location(2) uv: vec2f,
  @location(3) albedo: vec3f,
}

struct Pixel {
  @location(0) normal: vec4f,
  @location(1) albedo: vec4f,
}

@vertex
fn vertex(corner: Corner) -> Vertex {
  let position = mat4x4f(corner.x, corner.y, corner.z, corner.w) * vec4f(corner.position, 1.0);
  // Normals turn as planes do: by the matrix of cofactors, which is the inverse's transpose but for a factor.
  let cofactors = mat3x3f(
    cross(corner.y.xyz, corner.z.xyz),
    cross(corner.z.xyz, corner.x.xyz),
    cross(corner.x.xyz, corner.y.xyz),
  );
  return Vertex(
    view.projection * view.view * position,
    position.xyz - view.eye.xyz,
    cofactors * corner.normal,
    corner.uv,
    corner.albedo.rgb,
  );
}

// The interpolated normal, on the side of the face that is seen.
@fragment
fn fragment(in: Vertex) -> Pixel {
  var face = normalize(cross(dpdx(in.relative), dpdy(in.relative)));
  face = select(face, -face, dot(face, in.relative) > 0.0);
  let n = normalize(in.normal);
  let side = select(n, -n, dot(n, face) < 0.0);
  let color = textureSample(map, map_sampler, in.uv).rgb * in.albedo;
  return Pixel(vec4f(side, 0.0), vec4f(color, 1.0));
}
