// A dispatch dimension ends at 65535: larger counts wrap into rows of DISPATCH_ROW workgroups (src/gpu/mod.rs).
const DISPATCH_ROW: u32 = 32768u;

fn linear_workgroup(id: vec3u) -> u32 {
  return id.y * DISPATCH_ROW + id.x;
}
