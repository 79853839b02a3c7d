// Places the elements of each run, in order, behind all with a smaller digit and all of the same
// digit in earlier runs: the table was scanned.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments; // count: runs, detail: shift
@group(0) @binding(1) var<storage, read> total: array<u32>;
@group(0) @binding(2) var<storage, read> table: array<u32>;
@group(0) @binding(3) var<storage, read> keys: array<u32>;
@group(0) @binding(4) var<storage, read> values: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(6) var<storage, read_write> sorted_values: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let run = linear_thread(group, groups, lane);
    if run >= arguments.count { return; }
    var next = array<u32, DIGITS>();
    for (var digit = 0u; digit < DIGITS; digit++) {
        next[digit] = table[digit * arguments.count + run];
    }
    for (var i = run * SORT_RUN; i < min(run * SORT_RUN + SORT_RUN, total[0]); i++) {
        let key = keys[i];
        let digit = extractBits(key, arguments.detail, DIGIT_BITS);
        sorted_keys[next[digit]] = key;
        sorted_values[next[digit]] = values[i];
        next[digit] += 1u;
    }
}
