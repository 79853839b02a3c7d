// Writes the hits of each rank into its slots: tile as key, slot as payload. Slots that were
// counted but not filled get a tile that does not exist; slots beyond the capacity are dropped.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> coverage_from_rank: array<Coverage>;
@group(0) @binding(3) var<storage, read> gaussian_from_rank: array<u32>;
@group(0) @binding(4) var<storage, read> slot_from_rank: array<u32>;
@group(0) @binding(5) var<storage, read_write> keys: array<u32>;
@group(0) @binding(6) var<storage, read_write> slots: array<u32>;
@group(0) @binding(7) var<storage, read_write> gaussian_from_slot: array<u32>;
@group(0) @binding(8) var<storage, read_write> count: array<HitCount>;

fn visit(tile: u32, slot: u32, gaussian: u32) {
    keys[slot] = tile;
    slots[slot] = slot;
    gaussian_from_slot[slot] = gaussian;
}

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let rank = linear_thread(group, groups, lane);
    if rank == 0u {
        count[0] = tally(count[0]);
    }
    if rank >= pass_.count { return; }
    let first = slot_from_rank[rank];
    let end = min(slot_from_rank[rank + 1u], pass_.capacity);
    if first >= end { return; }
    var slot = walk(rank, first, end);
    for (; slot < end; slot++) {
        visit(pass_.tiles.x * pass_.tiles.y, slot, gaussian_from_rank[rank]);
    }
}
