// Writes the hits of each Gaussian into its slots: tile as key, slot as payload. Slots that were
// counted but not filled get a tile that does not exist; slots beyond the capacity are dropped.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> gaussian_from_rank: array<u32>;
@group(0) @binding(3) var<storage, read> slot_from_rank: array<u32>;
@group(0) @binding(4) var<storage, read_write> hits: array<u32>;
@group(0) @binding(5) var<storage, read_write> keys: array<u32>;
@group(0) @binding(6) var<storage, read_write> slots: array<u32>;
@group(0) @binding(7) var<storage, read_write> gaussian_from_slot: array<u32>;
@group(0) @binding(8) var<storage, read_write> count: array<HitCount>;

fn write_hit(slot: u32, tile: u32, gaussian: u32) {
    keys[slot] = tile;
    slots[slot] = slot;
    gaussian_from_slot[slot] = gaussian;
}

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let rank = linear_thread(group, groups, lane);
    if rank > pass_.count { return; }
    if rank == pass_.count {
        let wanted = slot_from_rank[rank];
        count[0] = HitCount(min(wanted, pass_.capacity), wanted);
        return;
    }
    let gaussian = gaussian_from_rank[rank];
    let counted = hits[gaussian];
    if counted == 0u { return; }
    let splat = splats[gaussian];
    let first = min(slot_from_rank[rank], pass_.capacity);
    let end = first + min(counted, pass_.capacity - first);
    let rect = tile_rect(splat);
    var slot = first;
    for (var y = rect.y; y < rect.w; y++) {
        for (var x = rect.x; x < rect.z; x++) {
            if slot < end && touches(splat, vec2<u32>(x, y)) {
                write_hit(slot, y * pass_.tiles.x + x, gaussian);
                slot += 1u;
            }
        }
    }
    hits[gaussian] = slot - first;
    for (; slot < end; slot++) {
        write_hit(slot, pass_.tiles.x * pass_.tiles.y, gaussian);
    }
}
