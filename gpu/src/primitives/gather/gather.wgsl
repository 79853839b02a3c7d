// to[i] = from[index[i] without its marks], unit by unit; zeros for newborns if asked for.

@group(0) @binding(0) var<uniform> arguments: GatherArguments;
@group(0) @binding(1) var<storage, read> index: array<u32>;
@group(0) @binding(2) var<storage, read> source: array<Unit>;
@group(0) @binding(3) var<storage, read_write> target_: array<Unit>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let unit = linear_thread(group, groups, lane);
    if unit >= arguments.count { return; }
    let element = unit / arguments.width;
    let entry = index[element];
    var value = source[(entry & INDEX_MASK) * arguments.width + unit - element * arguments.width];
    if arguments.fresh == 1u && (entry & FRESH) != 0u { value = Unit(); }
    target_[unit] = value;
}
