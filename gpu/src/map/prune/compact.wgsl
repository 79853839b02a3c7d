// source[slot] = i for each Gaussian i that stays, slot being the number of those before it. The
// last thread writes the total.

@group(0) @binding(0) var<uniform> arguments: PruneArguments;
@group(0) @binding(1) var<storage, read> kept: array<u32>; // scanned
@group(0) @binding(2) var<storage, read_write> source: array<u32>;
@group(0) @binding(3) var<storage, read_write> total: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let gaussian = linear_thread(group, groups, lane);
    if gaussian > arguments.count { return; }
    let slot = kept[gaussian];
    if gaussian == arguments.count {
        total[0] = slot;
    } else if kept[gaussian + 1u] > slot {
        source[slot] = gaussian;
    }
}
