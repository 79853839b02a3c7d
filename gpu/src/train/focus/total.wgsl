// The sum of the errors of all tiles that were measured, by one workgroup. It is more than 0.

@group(0) @binding(0) var<uniform> arguments: FocusArguments;
@group(0) @binding(1) var<storage, read> errors: array<f32>;
@group(0) @binding(2) var<storage, read_write> total: array<f32>;

var<workgroup> sums: array<f32, GROUP>;

@compute @workgroup_size(GROUP)
fn main(@builtin(local_invocation_index) lane: u32) {
    var sum = 0.0;
    for (var tile = lane; tile < arguments.tiles; tile += GROUP) {
        if errors[tile] < HUGE { sum += errors[tile]; }
    }
    sums[lane] = sum;
    workgroupBarrier();
    if lane > 0u { return; }
    sum = 0.0;
    for (var other = 0u; other < GROUP; other++) { sum += sums[other]; }
    total[0] = max(sum, EPSILON);
}
