// Where each tile's list begins and ends, and the Gaussian of each hit in it.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> count: array<HitCount>;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read> slot_from_sorted: array<u32>;
@group(0) @binding(4) var<storage, read> gaussian_from_slot: array<u32>;
@group(0) @binding(5) var<storage, read_write> gaussian_from_sorted: array<u32>;
@group(0) @binding(6) var<storage, read_write> ranges: array<vec2<u32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let hit = linear_thread(group, groups, lane);
    let drawn = count[0].drawn;
    if hit >= drawn { return; }
    gaussian_from_sorted[hit] = gaussian_from_slot[slot_from_sorted[hit]];
    let tile = keys[hit];
    if tile >= pass_.tiles.x * pass_.tiles.y { return; }
    if hit == 0u || keys[max(hit, 1u) - 1u] != tile {
        ranges[tile].x = hit;
    }
    if hit + 1u == drawn || keys[min(hit + 1u, drawn - 1u)] != tile {
        ranges[tile].y = hit + 1u;
    }
}
