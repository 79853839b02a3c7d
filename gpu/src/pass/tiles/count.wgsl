// Hits of each run in each tile: table[tile of the band * runs + run], zero before. Counts all hits.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> coverage_from_rank: array<Coverage>;
@group(0) @binding(3) var<storage, read> gaussian_from_rank: array<u32>;
@group(0) @binding(4) var<storage, read> slot_from_rank: array<u32>;
@group(0) @binding(5) var<storage, read_write> table: array<u32>;
@group(0) @binding(6) var<storage, read_write> count: array<HitCount>;

var<private> own_run: u32;

fn visit(tile: u32, slot: u32, gaussian: u32) {
    table[(tile - pass_.band.x * pass_.tiles.x) * pass_.runs + own_run] += 1u;
}

@compute @workgroup_size(SORT_GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    own_run = group.x * SORT_GROUP + lane;
    if own_run == 0u {
        count[0] = tally(count[0]);
    }
    if own_run < pass_.runs { walk_run(own_run); }
}
