// to[i] = from[index[i]], word by word.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments; // detail: words per element
@group(0) @binding(1) var<storage, read> index: array<u32>;
@group(0) @binding(2) var<storage, read> source: array<u32>;
@group(0) @binding(3) var<storage, read_write> target_: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let word = linear_thread(group, groups, lane);
    if word >= arguments.count { return; }
    let element = word / arguments.detail;
    target_[word] = source[index[element] * arguments.detail + word % arguments.detail];
}
