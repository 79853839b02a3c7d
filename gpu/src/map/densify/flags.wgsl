// kept[i] = 1 where a flag is set; one element more than flags, zero.

@group(0) @binding(0) var<uniform> arguments: DensifyArguments;
@group(0) @binding(1) var<storage, read> flags: array<u32>;
@group(0) @binding(2) var<storage, read_write> kept: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let gaussian = linear_thread(group, groups, lane);
    if gaussian > arguments.count { return; }
    var flag = 0u;
    if gaussian < arguments.count { flag = min(flags[gaussian], 1u); }
    kept[gaussian] = flag;
}
