// Writes the hits of each rank into its slots: tile as key, slot as payload. Slots that were
// counted but not filled get a tile that does not exist; slots beyond the capacity are dropped.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> coverage: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> gaussian_from_rank: array<u32>;
@group(0) @binding(4) var<storage, read> slot_from_rank: array<u32>;
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
    if rank == 0u {
        let wanted = slot_from_rank[pass_.count];
        let drawn = min(wanted, pass_.capacity);
        count[0] = HitCount(drawn, wanted, groups_for(drawn));
    }
    if rank >= pass_.count { return; }
    let first = slot_from_rank[rank];
    let end = min(slot_from_rank[rank + 1u], pass_.capacity);
    if first >= end { return; }
    let gaussian = gaussian_from_rank[rank];
    let splat = splats[gaussian];
    let rect = tile_rect(splat);
    let width = rect.z - rect.x;
    var slot = first;
    if area(rect) <= MASK_TILES {
        for (var mask = coverage[gaussian].y; mask != 0u && slot < end; mask &= mask - 1u) {
            let at = firstTrailingBit(mask);
            write_hit(slot, (rect.y + at / width) * pass_.tiles.x + rect.x + at % width, gaussian);
            slot += 1u;
        }
    } else {
        for (var y = rect.y; y < rect.w; y++) {
            for (var x = rect.x; x < rect.z; x++) {
                if slot < end && touches(splat, vec2<u32>(x, y)) {
                    write_hit(slot, y * pass_.tiles.x + x, gaussian);
                    slot += 1u;
                }
            }
        }
    }
    for (; slot < end; slot++) {
        write_hit(slot, pass_.tiles.x * pass_.tiles.y, gaussian);
    }
}
