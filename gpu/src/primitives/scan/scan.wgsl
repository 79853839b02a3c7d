// Exclusive prefix sum by runs: sums[r] = sum of run r; then, with the sums scanned,
// values[i] = sums[run of i] + values before i in its run.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments;
@group(0) @binding(1) var<storage, read_write> values: array<u32>;
@group(0) @binding(2) var<storage, read_write> sums: array<u32>;

/// a + b, at most the largest u32: a total that is too large stays too large.
fn add(a: u32, b: u32) -> u32 {
    return a + min(b, 0xffffffffu - a);
}

@compute @workgroup_size(GROUP)
fn sum_runs(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
            @builtin(local_invocation_index) lane: u32) {
    let run = linear_thread(group, groups, lane);
    if run * RUN >= arguments.count { return; }
    var sum = 0u;
    for (var i = run * RUN; i < min(run * RUN + RUN, arguments.count); i++) {
        sum = add(sum, values[i]);
    }
    sums[run] = sum;
}

@compute @workgroup_size(GROUP)
fn apply_runs(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
              @builtin(local_invocation_index) lane: u32) {
    let run = linear_thread(group, groups, lane);
    if run * RUN >= arguments.count { return; }
    var before = sums[run];
    for (var i = run * RUN; i < min(run * RUN + RUN, arguments.count); i++) {
        let value = values[i];
        values[i] = before;
        before = add(before, value);
    }
}
