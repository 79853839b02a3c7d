// Smallest box around the finite points of each run, as (low, high); then around the boxes of each
// run. A run without a finite point has low > high.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments;
@group(0) @binding(1) var<storage, read> rows: array<vec4<f32>>; // points, later boxes
@group(0) @binding(2) var<storage, read_write> boxes: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let run = linear_thread(group, groups, lane);
    if run * RUN >= arguments.count { return; }
    var low = vec4<f32>(HUGE);
    var high = vec4<f32>(-HUGE);
    for (var i = run * RUN; i < min(run * RUN + RUN, arguments.count); i++) {
        if POINTS {
            let p = rows[i];
            if is_finite(p.x) && is_finite(p.y) && is_finite(p.z) {
                low = min(low, p);
                high = max(high, p);
            }
        } else {
            low = min(low, rows[2u * i]);
            high = max(high, rows[2u * i + 1u]);
        }
    }
    boxes[2u * run] = low;
    boxes[2u * run + 1u] = high;
}
