// Sums the records of each Gaussian's hits, in slot order (see blend/backward.wgsl for the rows).
// The colour head's fourth feature is depth: its gradient goes to the free place in row 1.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments; // detail: feature rows
@group(0) @binding(1) var<storage, read> gaussian_from_rank: array<u32>;
@group(0) @binding(2) var<storage, read> slot_from_rank: array<u32>;
@group(0) @binding(3) var<storage, read> hits: array<u32>;
@group(0) @binding(4) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> sums: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> features: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let rank = linear_thread(group, groups, lane);
    if rank >= arguments.count { return; }
    let gaussian = gaussian_from_rank[rank];
    let record = 2u + arguments.detail;
    let first = slot_from_rank[rank];
    let count = hits[gaussian];
    for (var row = 0u; row < record; row++) {
        var sum = vec4<f32>(0.0);
        for (var hit = 0u; hit < count; hit++) {
            sum += records[(first + hit) * record + row];
        }
        if row < 2u {
            sums[2u * gaussian + row] = sum;
        } else if COLOUR {
            features[gaussian] = vec4<f32>(sum.xyz, 0.0);
            sums[2u * gaussian + 1u].w = sum.w;
        } else {
            features[arguments.detail * gaussian + row - 2u] = sum;
        }
    }
}
