// first |S_f - S_c|, S_c held fixed, summed over the axes of a Gaussian; the gradient is with
// respect to the language head's log scales and is added to what is there. Scales that are not
// finite are left out.

@group(0) @binding(0) var<uniform> arguments: LossArguments;
@group(0) @binding(1) var<storage, read> visible: array<Visible>;
@group(0) @binding(2) var<storage, read> gaussian_from_visible: array<u32>;
@group(0) @binding(3) var<storage, read> color: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> language: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> gradients: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> terms: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let index = linear_thread(group, groups, lane);
    if index >= visible[0].count { return; }
    let row = 2u * gaussian_from_visible[index] + 1u;
    terms[index] = vec4<f32>(0.0);
    let s = scales(language[row].xyz);
    let apart = s - scales(color[row].xyz);
    let term = arguments.first * dot(abs(apart), vec3<f32>(1.0));
    if !is_finite(term) { return; }
    terms[index].x = term;
    gradients[2u * index + 1u] += vec4<f32>(arguments.first * sign(apart) * s, 0.0);
}
