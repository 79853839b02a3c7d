// Places the elements of each run, in order, behind all with a smaller digit and all of the same
// digit in earlier runs: the table was scanned. With INDICES the payload of an
// element is its place.

@group(0) @binding(0) var<uniform> arguments: SortArguments;
@group(0) @binding(1) var<storage, read> total: array<u32>;
@group(0) @binding(2) var<storage, read_write> table: array<u32>;
@group(0) @binding(3) var<storage, read> keys: array<u32>;
@group(0) @binding(4) var<storage, read> values: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(6) var<storage, read_write> sorted_values: array<u32>;

@compute @workgroup_size(SORT_GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let run = group.x * SORT_GROUP + lane;
    if run >= arguments.runs { return; }
    let length = (total[0] + arguments.runs - 1u) / arguments.runs;
    for (var i = run * length; i < min(run * length + length, total[0]); i++) {
        let key = keys[i];
        let cell = extractBits(key, arguments.shift, arguments.bits) * arguments.runs + run;
        let place = table[cell];
        table[cell] = place + 1u;
        sorted_keys[place] = key;
        if INDICES {
            sorted_values[place] = i;
        } else {
            sorted_values[place] = values[i];
        }
    }
}
