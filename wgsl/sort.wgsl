// Sorts keys with a value each, 4 bits at a time from the lowest (LSD radix sort): each pass counts the digits of every
// block of 1024 keys, scans the counts (wgsl/scan.wgsl), and moves the keys to their places. Stable, so the result does
// not depend on the order of threads.
//
//   count_digits   a workgroup a block; blocks behind the last key count nothing
//   (prefix sum)
//   move_keys      a workgroup a block

#import dispatch

struct Params {
  shift: u32,
  // Blocks that there is room for.
  blocks: u32,
  padding0: u32,
  padding1: u32,
}

struct Item {
  key: u32,
  value: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
// How many keys there are.
@group(0) @binding(1) var<storage, read> length: array<u32>;
@group(0) @binding(2) var<storage, read> unsorted: array<Item>;
@group(0) @binding(3) var<storage, read_write> sorted: array<Item>;
// Digit by digit, one count per block.
@group(0) @binding(4) var<storage, read_write> counts: array<u32>;

const DIGITS: u32 = 16u;
const THREADS: u32 = 64u;
const PER_THREAD: u32 = 16u;
const BLOCK: u32 = THREADS * PER_THREAD;

// One row per digit, one column per thread.
var<workgroup> columns: array<u32, 1024>;

fn digit_at(i: u32) -> u32 {
  return (unsorted[i].key >> params.shift) & (DIGITS - 1u);
}

fn count_own(first: u32, end: u32, thread: u32) {
  for (var d = 0u; d < DIGITS; d++) {
    columns[d * THREADS + thread] = 0u;
  }
  for (var i = first; i < end; i++) {
    columns[digit_at(i) * THREADS + thread]++;
  }
}

@compute @workgroup_size(64)
fn count_digits(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let block = linear_workgroup(workgroup);
  if block * BLOCK >= length[0] {
    if thread < DIGITS && block < params.blocks {
      counts[thread * params.blocks + block] = 0u;
    }
    return;
  }
  let first = block * BLOCK + thread * PER_THREAD;
  count_own(first, min(first + PER_THREAD, length[0]), thread);
  workgroupBarrier();
  if thread < DIGITS && block < params.blocks {
    var total = 0u;
    for (var t = 0u; t < THREADS; t++) {
      total += columns[thread * THREADS + t];
    }
    counts[thread * params.blocks + block] = total;
  }
}

@compute @workgroup_size(64)
fn move_keys(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let block = linear_workgroup(workgroup);
  if block * BLOCK >= length[0] {
    return;
  }
  let first = block * BLOCK + thread * PER_THREAD;
  let end = min(first + PER_THREAD, length[0]);
  count_own(first, end, thread);
  workgroupBarrier();
  if thread < DIGITS && block < params.blocks {
    var place = counts[thread * params.blocks + block];
    for (var t = 0u; t < THREADS; t++) {
      let own = columns[thread * THREADS + t];
      columns[thread * THREADS + t] = place;
      place += own;
    }
  }
  workgroupBarrier();
  for (var i = first; i < end; i++) {
    let column = digit_at(i) * THREADS + thread;
    sorted[columns[column]] = unsorted[i];
    columns[column]++;
  }
}
