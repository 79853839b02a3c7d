// A tied parameter has one gradient: color gradient += language gradient where `tied`. A Gaussian
// that one head saw counts as seen by the other.

@group(0) @binding(0) var<uniform> arguments: TieArguments;
@group(0) @binding(1) var<storage, read> language_sums: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> language: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> color_sums: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> color: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let index = linear_thread(group, groups, lane);
    if index >= arguments.count { return; }
    color[2u * index] += arguments.even * language[2u * index];
    color[2u * index + 1u] += arguments.odd * language[2u * index + 1u];
    color_sums[3u * index].w += language_sums[2u * index].w;
}
