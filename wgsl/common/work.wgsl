// Which pixel an invocation computes (src/work.rs): all pixels of a sub-image in workgroups of 8 x 8, or those of a list
// that the GPU made, 64 per workgroup.
//
// The importer declares `params` with `camera: Camera` and `level: u32`; with LIST, `work`:
//   var<storage, read> work: array<u32>   the count, then x | y << 16 of each pixel of the sub-image
// Kernels are of @workgroup_size(8, 8).

#needs params
#if LIST
#needs work
#endif

#import sub_image

struct WorkItem {
  // False for the invocations that have none.
  valid: bool,
  // The pixel of the G-buffer that is computed, from the viewport's corner.
  pixel: vec2u,
  // The pixel of the sub-image that it is written to.
  texel: vec2u,
}

fn work_item(workgroup: vec3u, workgroups: vec3u, local_index: u32) -> WorkItem {
  let size = params.camera.viewport.zw;
#if LIST
  let i = (workgroup.y * workgroups.x + workgroup.x) * 64u + local_index;
  let valid = i < min(work[0], arrayLength(&work) - 1u);
  let packed = work[select(0u, i + 1u, valid)];
  let texel = vec2u(packed & 0xffffu, packed >> 16u);
#else
  let texel = workgroup.xy * 8u + vec2u(local_index & 7u, local_index >> 3u);
  let valid = all(texel < ((size - 1u) >> vec2u(params.level)) + 1u);
#endif
  return WorkItem(valid, stands_for(texel, params.level, size), texel);
}
