// Where each tile's list begins and ends: after all hits were placed, a cell of the table is the
// end of its run in its tile.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> table: array<u32>;
@group(0) @binding(2) var<storage, read_write> ranges: array<vec2<u32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = linear_thread(group, groups, lane);
    let above = pass_.band.x * pass_.tiles.x;
    if above + tile >= pass_.band.y * pass_.tiles.x { return; }
    var first = 0u;
    if tile > 0u { first = table[tile * pass_.runs - 1u]; }
    ranges[above + tile] = vec2<u32>(first, table[tile * pass_.runs + pass_.runs - 1u]);
}
