// first |exp(a) rgb + b - target| + second |D - D_gt| of a pixel, and its gradient. A target is a
// byte for each of r, g, b and for whether there is a color, and the depth's bits; a negative depth
// is no measurement.

@group(0) @binding(0) var<uniform> arguments: LossArguments;
@group(0) @binding(1) var<storage, read> image: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> target_: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> gradients: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> terms: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let pixel = linear_thread(group, groups, lane);
    if pixel >= arguments.count { return; }
    let packed = target_[pixel];
    let color = unpack4x8unorm(packed.x);
    let wanted = vec4<f32>(color.xyz, bitcast<f32>(packed.y));
    let gain = vec4<f32>(vec3<f32>(exp(arguments.exposure.x)), 1.0);
    let exposed = gain * image[pixel];
    let off = exposed + vec4<f32>(vec3<f32>(arguments.exposure.y), 0.0) - wanted;
    let factor = vec4<f32>(vec3<f32>(arguments.first), arguments.second);
    let valid = vec4<f32>(vec3<f32>(color.w - 0.5), wanted.w) >= vec4<f32>(0.0);
    let used = select(vec4<f32>(0.0), factor, valid);
    let d_off = used * sign(off);
    gradients[pixel] = gain * d_off;
    let term = used * abs(off);
    terms[pixel] = vec4<f32>(term.x + term.y + term.z, term.w, dot(d_off.xyz, exposed.xyz),
        d_off.x + d_off.y + d_off.z);
}
