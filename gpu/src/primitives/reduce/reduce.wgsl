// sums[slot + r] = sum of one row of each element of run r; elements from the limit on count as 0.

@group(0) @binding(0) var<uniform> arguments: ReduceArguments;
@group(0) @binding(1) var<storage, read> limit: array<u32>;
@group(0) @binding(2) var<storage, read> rows: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> sums: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let run = linear_thread(group, groups, lane);
    if run * RUN >= arguments.count { return; }
    let end = min(run * RUN + RUN, min(arguments.count, limit[0]));
    var sum = vec4<f32>(0.0);
    for (var i = run * RUN; i < end; i++) {
        sum += rows[i * arguments.stride + arguments.row];
    }
    sums[arguments.slot + run] = sum;
}
