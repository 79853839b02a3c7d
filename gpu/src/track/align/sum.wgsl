// Sums runs of RUN partial normal systems of each comparison: thread = (comparison, run, row), in a fixed
// order.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments; // count: systems of one; detail: comparisons
@group(0) @binding(1) var<storage, read> partials: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> sums: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let slot = linear_thread(group, groups, lane);
    let runs = (arguments.count + RUN - 1u) / RUN;
    let comparison = slot / (runs * SYSTEM_ROWS);
    if comparison >= arguments.detail { return; }
    let run = slot / SYSTEM_ROWS - comparison * runs;
    let row = slot % SYSTEM_ROWS;
    let first = comparison * arguments.count;
    var sum = vec4<f32>(0.0);
    for (var i = run * RUN; i < min(run * RUN + RUN, arguments.count); i++) {
        sum += partials[(first + i) * SYSTEM_ROWS + row];
    }
    sums[slot] = sum;
}
