// The error of each tile that was drawn, from the terms of each of its rows of pixels. If a list of the
// step overflowed, errors stay as they were, so that the step can be repeated. Afterwards no tile is left
// out any more.

@group(0) @binding(0) var<uniform> arguments: FocusArguments;
@group(0) @binding(1) var<storage, read> terms: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> count: array<HitCount>;
@group(0) @binding(3) var<storage, read_write> left_out: array<u32>;
@group(0) @binding(4) var<storage, read_write> errors: array<f32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = linear_thread(group, groups, lane);
    if tile >= arguments.tiles { return; }
    let is_left_out = left_out[tile] != 0u;
    left_out[tile] = 0u;
    if is_left_out || count[0].missing > 0u { return; }
    var sum = 0.0;
    for (var row = tile * TILE_HEIGHT; row < (tile + 1u) * TILE_HEIGHT; row++) {
        sum += terms[row].x + terms[row].y;
    }
    errors[tile] = sum;
}
