// Self-test of subgroups: five values per thread: size, lane, sum, the value of lane 0, and that of
// lane 3 after a round trip through floats (exact below 2^24). The number of threads is a multiple
// of the workgroup's size, so that control flow is uniform.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments;
@group(0) @binding(1) var<storage, read> given: array<u32>;
@group(0) @binding(2) var<storage, read_write> found: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32, @builtin(subgroup_size) size: u32,
        @builtin(subgroup_invocation_id) subgroup_lane: u32) {
    let thread = linear_thread(group, groups, lane);
    let value = given[min(thread, arguments.count - 1u)];
    let sum = subgroupAdd(value);
    let first = subgroupBroadcastFirst(value);
    let fourth = u32(subgroupBroadcast(f32(value), 3u));
    if thread >= arguments.count { return; }
    found[5u * thread] = size;
    found[5u * thread + 1u] = subgroup_lane;
    found[5u * thread + 2u] = sum;
    found[5u * thread + 3u] = first;
    found[5u * thread + 4u] = fourth;
}
