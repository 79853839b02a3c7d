// slots[i] = 1 where either head of Gaussian i has a hit, ready to be scanned; the last becomes the
// total.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments;
@group(0) @binding(1) var<storage, read> one: array<Coverage>;
@group(0) @binding(2) var<storage, read> other: array<Coverage>;
@group(0) @binding(3) var<storage, read_write> slots: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let gaussian = linear_thread(group, groups, lane);
    if gaussian > arguments.count { return; }
    var seen = false;
    if gaussian < arguments.count { seen = (one[gaussian].hits | other[gaussian].hits) != 0u; }
    slots[gaussian] = u32(seen);
}
