// Coverage in the order of ranks, and its hits ready to be scanned; ranks beyond the visible ones
// have none, and the last element becomes the total. Of several bands, the tiles of this one count.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> visible: array<Visible>;
@group(0) @binding(2) var<storage, read> gaussian_from_rank: array<u32>;
@group(0) @binding(3) var<storage, read> coverage: array<Coverage>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
@group(0) @binding(5) var<storage, read> left_out: array<u32>;
@group(0) @binding(6) var<storage, read_write> slot_from_rank: array<u32>;
@group(0) @binding(7) var<storage, read_write> coverage_from_rank: array<Coverage>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let rank = linear_thread(group, groups, lane);
    if rank > pass_.count { return; }
    var hits = 0u;
    if rank < visible[0].count {
        let gaussian = gaussian_from_rank[rank];
        var found = coverage[gaussian];
        if found.hits > 0u && pass_.bands > 1u { found = covered(splats[gaussian]); }
        coverage_from_rank[rank] = found;
        hits = found.hits;
    }
    slot_from_rank[rank] = hits;
}
