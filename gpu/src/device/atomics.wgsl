// Self-test of integer atomics, as blend/weights.wgsl uses them: out[i mod detail] = max in[i].

@group(0) @binding(0) var<uniform> arguments: ArrayArguments; // detail: number of slots
@group(0) @binding(1) var<storage, read> given: array<u32>;
@group(0) @binding(2) var<storage, read_write> found: array<atomic<u32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let thread = linear_thread(group, groups, lane);
    if thread >= arguments.count { return; }
    atomicMax(&found[thread % arguments.detail], given[thread]);
}
