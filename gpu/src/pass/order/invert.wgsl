// From the sorted payload, visible_from_rank, to the two ways that others go.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments;
@group(0) @binding(1) var<storage, read> visible: array<Visible>;
@group(0) @binding(2) var<storage, read> visible_from_rank: array<u32>;
@group(0) @binding(3) var<storage, read> gaussian_from_visible: array<u32>;
@group(0) @binding(4) var<storage, read_write> rank_from_visible: array<u32>;
@group(0) @binding(5) var<storage, read_write> gaussian_from_rank: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let rank = linear_thread(group, groups, lane);
    if rank >= min(visible[0].count, arguments.count) { return; }
    let index = visible_from_rank[rank];
    rank_from_visible[index] = rank;
    gaussian_from_rank[rank] = gaussian_from_visible[index];
}
