// to[i] = from[index[i]], unit by unit. arguments: units to write, and units per element.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments;
@group(0) @binding(1) var<storage, read> index: array<u32>;
@group(0) @binding(2) var<storage, read> source: array<Unit>;
@group(0) @binding(3) var<storage, read_write> target_: array<Unit>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let unit = linear_thread(group, groups, lane);
    if unit >= arguments.count { return; }
    let width = arguments.detail;
    let element = unit / width;
    target_[unit] = source[index[element] * width + unit - element * width];
}
