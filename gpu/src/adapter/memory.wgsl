// Self-test of workgroup memory and barriers: out[i] = in[mirror of i in its workgroup] + sum of
// the workgroup, the sum as a tree.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments;
@group(0) @binding(1) var<storage, read> given: array<u32>;
@group(0) @binding(2) var<storage, read_write> found: array<u32>;

var<workgroup> values: array<u32, GROUP>;
var<workgroup> sums: array<u32, GROUP>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let thread = linear_thread(group, groups, lane);
    var value = 0u;
    if thread < arguments.count { value = given[thread]; }
    values[lane] = value;
    sums[lane] = value;
    workgroupBarrier();
    for (var half = GROUP / 2u; half > 0u; half /= 2u) {
        if lane < half { sums[lane] += sums[lane + half]; }
        workgroupBarrier();
    }
    if thread < arguments.count { found[thread] = values[GROUP - 1u - lane] + sums[0]; }
}
