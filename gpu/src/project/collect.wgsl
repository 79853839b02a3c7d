// Sums the records of each rank's hits, in slot order (see blend/backward.wgsl for the rows). The
// colour head's fourth feature is depth: its gradient goes to the third row of the sums.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> slot_from_rank: array<u32>;
@group(0) @binding(2) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> sums: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> features: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let rank = linear_thread(group, groups, lane);
    if rank >= pass_.count { return; }
    let first = slot_from_rank[rank];
    let end = min(slot_from_rank[rank + 1u], pass_.capacity);
    var sum: array<vec4<f32>, RECORD>;
    for (var slot = first; slot < end; slot++) {
        //repeat row RECORD
        sum[$row] += records[slot * RECORD + $row];
        //end
    }
    sums[SUMS * rank] = sum[0];
    sums[SUMS * rank + 1u] = sum[1];
    //repeat row ROWS
    if COLOUR {
        sums[SUMS * rank + 2u] = vec4<f32>(sum[2].w, 0.0, 0.0, 0.0);
        features[rank] = vec4<f32>(sum[2].xyz, 0.0);
    } else {
        features[ROWS * rank + $row] = sum[2u + $row];
    }
    //end
}
