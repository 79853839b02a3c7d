// kept[i] = 1 if Gaussian i stays, else 0; see mod.rs for the rule. A parameter that is not a
// number fails its comparison. There is one element more than Gaussians, which is 0, so that the
// exclusive scan ends in the total.

@group(0) @binding(0) var<uniform> arguments: PruneArguments;
@group(0) @binding(1) var<storage, read> color_geometry: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> language_geometry: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> means: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> kept: array<u32>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let gaussian = linear_thread(group, groups, lane);
    if gaussian > arguments.count { return; }
    kept[gaussian] = 0u;
    if gaussian == arguments.count { return; }
    let color = color_geometry[2u * gaussian + 1u];
    let language = language_geometry[2u * gaussian + 1u];
    let opaque = color.w >= arguments.min_logit || language.w >= arguments.min_logit;
    let has_size = all(color.xyz < vec3<f32>(HUGE));
    let mean = means[gaussian].xyz;
    let has_place = is_finite(mean.x) && is_finite(mean.y) && is_finite(mean.z);
    if opaque && has_size && has_place { kept[gaussian] = 1u; }
}
