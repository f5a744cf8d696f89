// Exclusive prefix sums that saturate at 2^32 - 1, in place: each workgroup scans a block of BLOCK values and leaves
// its total; the totals are scanned the same way and added back.
//
// Saturating addition of non-negative numbers is associative, so the order of the tree does not matter.
//
// @group(0) @binding(0) values: scanned in place
// @group(0) @binding(1) totals: one per block

@group(0) @binding(0) var<storage, read_write> values: array<u32>;
@group(0) @binding(1) var<storage, read_write> totals: array<u32>;

#import dispatch

const THREADS: u32 = 256u;
const PER_THREAD: u32 = 4u;
const BLOCK: u32 = THREADS * PER_THREAD;

var<workgroup> sums: array<u32, THREADS>;

fn add(a: u32, b: u32) -> u32 {
  let sum = a + b;
  return select(sum, 0xffffffffu, sum < a);
}

@compute @workgroup_size(256)
fn scan_blocks(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let block = linear_workgroup(workgroup);
  let count = arrayLength(&values);
  let first = block * BLOCK + thread * PER_THREAD;
  var own: array<u32, PER_THREAD>;
  var sum = 0u;
  for (var i = 0u; i < PER_THREAD; i++) {
    own[i] = sum;
    if first + i < count {
      sum = add(sum, values[first + i]);
    }
  }
  sums[thread] = sum;
  workgroupBarrier();
  // Inclusive sums over the threads, doubling the reach at each step.
  for (var reach = 1u; reach < THREADS; reach *= 2u) {
    var other = 0u;
    if thread >= reach {
      other = sums[thread - reach];
    }
    workgroupBarrier();
    sums[thread] = add(sums[thread], other);
    workgroupBarrier();
  }
  var before = 0u;
  if thread > 0u {
    before = sums[thread - 1u];
  }
  for (var i = 0u; i < PER_THREAD; i++) {
    if first + i < count {
      values[first + i] = add(before, own[i]);
    }
  }
  if thread == THREADS - 1u && block < arrayLength(&totals) {
    totals[block] = sums[thread];
  }
}

@compute @workgroup_size(256)
fn add_totals(@builtin(workgroup_id) workgroup: vec3u, @builtin(local_invocation_index) thread: u32) {
  let block = linear_workgroup(workgroup);
  let count = arrayLength(&values);
  let first = block * BLOCK + thread * PER_THREAD;
  for (var i = 0u; i < PER_THREAD; i++) {
    if first + i < count {
      values[first + i] = add(values[first + i], totals[block]);
    }
  }
}
