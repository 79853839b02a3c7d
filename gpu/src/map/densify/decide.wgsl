// Who stays and who gives birth; see mod.rs for the rules. Written so that a parameter that is not
// a number fails. One element more than Gaussians, zero, so that the scans end in their totals.

@group(0) @binding(0) var<uniform> arguments: DensifyArguments;
@group(0) @binding(1) var<storage, read> color_geometry: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> language_geometry: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> statistics: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> means: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> kept: array<u32>;
@group(0) @binding(6) var<storage, read_write> births: array<u32>;
@group(0) @binding(7) var<storage, read_write> splits: array<u32>;

/// True if no axis is longer than e^limit.
fn within(shape: vec4<f32>, limit: f32) -> bool {
    return shape.x <= limit && shape.y <= limit && shape.z <= limit;
}

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let gaussian = linear_thread(group, groups, lane);
    if gaussian > arguments.count { return; }
    kept[gaussian] = 0u;
    births[gaussian] = 0u;
    splits[gaussian] = 0u;
    if gaussian == arguments.count { return; }
    let color = color_geometry[2u * gaussian + 1u];
    let language = language_geometry[2u * gaussian + 1u];
    let seen = statistics[2u * gaussian];
    let opaque = color.w >= arguments.min_logit || language.w >= arguments.min_logit;
    let fits = within(color, arguments.max_log_scale)
        && (arguments.either_head == 0u || within(language, arguments.max_log_scale));
    let mean = means[gaussian].xyz;
    let somewhere = is_finite(mean.x) && is_finite(mean.y) && is_finite(mean.z);
    if !(opaque && fits && somewhere) || seen.z > arguments.max_radius { return; }
    kept[gaussian] = 1u;
    if !(seen.y > 0.0 && seen.x >= arguments.min_gradient * seen.y) { return; }
    let small = within(color, arguments.clone_log_scale);
    if small && !within(language, arguments.clone_log_scale) { return; }
    births[gaussian] = 1u;
    splits[gaussian] = select(1u, 0u, small);
}
