// first |code - target| of a pixel, summed over channels, and its gradient. Channels that fill the
// last row are 0 on both sides.

@group(0) @binding(0) var<uniform> arguments: LossArguments;
@group(0) @binding(1) var<storage, read> image: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> target_: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> gradients: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> terms: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let pixel = linear_thread(group, groups, lane);
    if pixel >= arguments.count { return; }
    var sum = 0.0;
    for (var row = pixel * arguments.rows; row < (pixel + 1u) * arguments.rows; row++) {
        let off = image[row] - target_[row];
        gradients[row] = arguments.first * sign(off);
        sum += dot(abs(off), vec4<f32>(arguments.first));
    }
    terms[pixel] = vec4<f32>(sum, 0.0, 0.0, 0.0);
}
