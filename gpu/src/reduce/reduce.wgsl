// sums[detail + r] = sum of run r.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments; // detail: first slot of the sums
@group(0) @binding(1) var<storage, read> rows: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> sums: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let run = linear_thread(group, groups, lane);
    if run * RUN >= arguments.count { return; }
    var sum = vec4<f32>(0.0);
    for (var i = run * RUN; i < min(run * RUN + RUN, arguments.count); i++) {
        sum += rows[i];
    }
    sums[arguments.detail + run] = sum;
}
