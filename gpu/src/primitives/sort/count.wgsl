// Digits of each run: table[digit * runs + run] = number of its keys with that digit.

@group(0) @binding(0) var<uniform> arguments: SortArguments;
@group(0) @binding(1) var<storage, read> total: array<u32>;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> table: array<u32>;

@compute @workgroup_size(SORT_GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let run = group.x * SORT_GROUP + lane;
    if run >= arguments.runs { return; }
    for (var digit = 0u; digit < (1u << arguments.bits); digit++) {
        table[digit * arguments.runs + run] = 0u;
    }
    let length = (total[0] + arguments.runs - 1u) / arguments.runs;
    for (var i = run * length; i < min(run * length + length, total[0]); i++) {
        table[extractBits(keys[i], arguments.shift, arguments.bits) * arguments.runs + run] += 1u;
    }
}
