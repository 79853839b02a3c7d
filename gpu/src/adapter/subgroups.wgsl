// Self-test of subgroups: six values per thread: size, lane, largest value, sum by exchange between
// lanes, the value of lane 0 and that of the mirrored lane, the last three by way of floats (exact
// below 2^24). WIDTH is the workgroup's size. The number of threads is a multiple of it, so that
// control flow is uniform.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments;
@group(0) @binding(1) var<storage, read> given: array<u32>;
@group(0) @binding(2) var<storage, read_write> found: array<u32>;

@compute @workgroup_size(WIDTH)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32, @builtin(subgroup_size) size: u32,
        @builtin(subgroup_invocation_id) subgroup_lane: u32) {
    let thread = linear_group(group, groups) * WIDTH + lane;
    let value = given[min(thread, arguments.count - 1u)];
    let lanes = min(size, WIDTH);
    let most = subgroupMax(value);
    var sum = f32(value);
    for (var step = 1u; step < lanes; step *= 2u) {
        sum += subgroupShuffleXor(sum, step);
    }
    let first = subgroupBroadcastFirst(f32(value));
    let mirrored = subgroupShuffle(f32(value), lanes - 1u - subgroup_lane);
    if thread >= arguments.count { return; }
    found[6u * thread] = size;
    found[6u * thread + 1u] = subgroup_lane;
    found[6u * thread + 2u] = most;
    found[6u * thread + 3u] = u32(sum);
    found[6u * thread + 4u] = u32(first);
    found[6u * thread + 5u] = u32(mirrored);
}
