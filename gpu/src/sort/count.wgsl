// Digits of each run: table[digit * runs + run] = number of its keys with that digit.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments; // count: runs, detail: shift
@group(0) @binding(1) var<storage, read> total: array<u32>;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> table: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let run = linear_thread(group, groups, lane);
    if run >= arguments.count { return; }
    var counts = array<u32, DIGITS>();
    for (var i = run * SORT_RUN; i < min(run * SORT_RUN + SORT_RUN, total[0]); i++) {
        counts[extractBits(keys[i], arguments.detail, DIGIT_BITS)] += 1u;
    }
    for (var digit = 0u; digit < DIGITS; digit++) {
        table[digit * arguments.count + run] = counts[digit];
    }
}
