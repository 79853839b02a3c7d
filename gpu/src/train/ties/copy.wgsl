// The language head takes the color head's parameters where `tied`, if the step moved the
// Gaussian.

@group(0) @binding(0) var<uniform> arguments: TieArguments;
@group(0) @binding(1) var<storage, read> gaussian_from_visible: array<u32>;
@group(0) @binding(2) var<storage, read> corrections: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> color: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> language: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let index = linear_thread(group, groups, lane);
    if index >= arguments.count || !(corrections[index].x > 0.0) { return; }
    let row = 2u * gaussian_from_visible[index];
    language[row] = select(language[row], color[row], arguments.even > vec4<f32>(0.0));
    language[row + 1u] =
        select(language[row + 1u], color[row + 1u], arguments.odd > vec4<f32>(0.0));
}
