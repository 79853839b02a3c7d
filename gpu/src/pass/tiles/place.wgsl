// Puts each hit into its tile's list, behind those of earlier runs: the table was scanned.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> coverage_from_rank: array<Coverage>;
@group(0) @binding(3) var<storage, read> gaussian_from_rank: array<u32>;
@group(0) @binding(4) var<storage, read> slot_from_rank: array<u32>;
@group(0) @binding(5) var<storage, read_write> table: array<u32>;
@group(0) @binding(6) var<storage, read_write> slot_from_sorted: array<u32>;
@group(0) @binding(7) var<storage, read_write> gaussian_from_sorted: array<u32>;

var<private> own_run: u32;

fn visit(tile: u32, slot: u32, gaussian: u32) {
    let cell = (tile - pass_.band.x * pass_.tiles.x) * pass_.runs + own_run;
    let place = table[cell];
    table[cell] = place + 1u;
    slot_from_sorted[place] = slot;
    gaussian_from_sorted[place] = gaussian;
}

@compute @workgroup_size(SORT_GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    own_run = group.x * SORT_GROUP + lane;
    if own_run < pass_.runs { walk_run(own_run); }
}
