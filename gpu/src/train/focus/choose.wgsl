// Draws the tiles of a step: one with a larger error is more likely to be drawn. A tile that was not
// measured yet is drawn.

@group(0) @binding(0) var<uniform> arguments: FocusArguments;
@group(0) @binding(1) var<storage, read> errors: array<f32>;
@group(0) @binding(2) var<storage, read> total: array<f32>;
@group(0) @binding(3) var<storage, read_write> left_out: array<u32>;

/// A number from 0 to 1 that looks random (the finaliser of MurmurHash3).
fn random(seed: u32) -> f32 {
    var h = seed;
    h = (h ^ (h >> 16u)) * 0x85ebca6bu;
    h = (h ^ (h >> 13u)) * 0xc2b2ae35u;
    return f32((h ^ (h >> 16u)) >> 8u) / 16777216.0;
}

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = linear_thread(group, groups, lane);
    if tile >= arguments.tiles { return; }
    let share = arguments.mean_share * errors[tile] * f32(arguments.tiles) / total[0];
    let drawn = random(tile + arguments.turn * 0x9e3779b9u) < max(share, arguments.least_share);
    left_out[tile] = u32(errors[tile] < HUGE && !drawn);
}
