// A camera's frame: packed 8 bit color and depth to (intensity, depth). Intensity is luma in
// [0, 1]; a depth that is not a positive number becomes 0, no measurement.

@group(0) @binding(0) var<uniform> arguments: PyramidArguments;
@group(0) @binding(1) var<storage, read> frame: array<vec2<u32>>; // r g b 0 from the lowest byte; depth's bits
@group(0) @binding(2) var<storage, read_write> bases: array<vec2<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let pixel = linear_thread(group, groups, lane);
    if pixel >= arguments.size.x * arguments.size.y { return; }
    let packed = frame[pixel];
    let depth = measured(bitcast<f32>(packed.y));
    bases[pixel] = vec2<f32>(luma(unpack4x8unorm(packed.x).xyz), depth);
}
