// A camera's frame, 8 bit color and depth, to (intensity, depth). Intensity is luma in [0, 1]; a depth that
// is not a positive number becomes 0, no measurement.

@group(0) @binding(0) var<uniform> arguments: PyramidArguments;
@group(0) @binding(1) var<storage, read> rgb8: array<u32>; // r, g, b of the first pixel, r of the next, ...
@group(0) @binding(2) var<storage, read> depth_metres: array<f32>;
@group(0) @binding(3) var<storage, read_write> bases: array<vec2<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let pixel = linear_thread(group, groups, lane);
    if pixel >= arguments.size.x * arguments.size.y { return; }
    let byte = 3u * pixel;
    let word = byte / 4u;
    let shift = 8u * (byte % 4u);
    // The last two thirds may begin the next word.
    let next = rgb8[min(word + 1u, arrayLength(&rgb8) - 1u)];
    let packed = (rgb8[word] >> shift) | select(0u, next << ((32u - shift) % 32u), shift > 8u);
    bases[pixel] = vec2<f32>(luma(unpack4x8unorm(packed).xyz), measured(depth_metres[pixel]));
}
