// Sums the records of the hits of each visible Gaussian, in slot order; blend/backward.wgsl has the
// rows. The fourth feature of the color head is depth: its gradient goes to the third row of the
// sums. Behind the first band the sums go on from those of the bands above, so that bands change no
// bit.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> visible: array<Visible>;
@group(0) @binding(2) var<storage, read> rank_from_visible: array<u32>;
@group(0) @binding(3) var<storage, read> slot_from_rank: array<u32>;
@group(0) @binding(4) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> sums: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> features: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let index = linear_thread(group, groups, lane);
    if index >= pass_.count { return; }
    var first = 0u;
    var end = 0u;
    if index < visible[0].count {
        let rank = rank_from_visible[index];
        first = slot_from_rank[rank];
        end = min(slot_from_rank[rank + 1u], pass_.capacity);
    }
    var sum: array<vec4<f32>, RECORD>;
    if pass_.band.x > 0u {
        sum[0] = sums[SUMS * index];
        sum[1] = sums[SUMS * index + 1u];
        //repeat row ROWS
        if COLOR {
            sum[2] = vec4<f32>(features[index].xyz, sums[SUMS * index + 2u].x);
        } else {
            sum[2u + $row] = features[ROWS * index + $row];
        }
        //end
    }
    for (var slot = first; slot < end; slot++) {
        //repeat row RECORD
        sum[$row] += records[slot * RECORD + $row];
        //end
    }
    sums[SUMS * index] = sum[0];
    sums[SUMS * index + 1u] = sum[1];
    //repeat row ROWS
    if COLOR {
        sums[SUMS * index + 2u] = vec4<f32>(sum[2].w, 0.0, 0.0, 0.0);
        features[index] = vec4<f32>(sum[2].xyz, 0.0);
    } else {
        features[ROWS * index + $row] = sum[2u + $row];
    }
    //end
}
