// A child of a split: mean += R_c S_c z with z ~ N(0, 1)^3, that is N(mean, Sigma_c); then the log
// scales of both heads -= ln 1.6. The parent's parameters are already in the child's slot.
// z: Box-Muller on a hash (PCG-RXS-M-XS, O'Neill 2014) of seed, parent and which child.

@group(0) @binding(0) var<uniform> arguments: DensifyArguments; // count: Gaussians afterwards
@group(0) @binding(1) var<storage, read> source: array<u32>;
@group(0) @binding(2) var<storage, read_write> means: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> color_geometry: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> language_geometry: array<vec4<f32>>;

fn hash(x: u32) -> u32 {
    let state = x * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

/// In (0, 1].
fn uniform_number(x: u32) -> f32 {
    return (f32(hash(x) >> 8u) + 0.5) / 16777216.0;
}

/// Three numbers with mean 0 and variance 1.
fn normal(stream: u32) -> vec3<f32> {
    let radius = sqrt(-2.0 * log(vec2<f32>(uniform_number(stream), uniform_number(stream + 1u))));
    let turns = vec2<f32>(uniform_number(stream + 2u), uniform_number(stream + 3u));
    let angle = 6.2831853 * (turns - 0.5);
    return vec3<f32>(radius.x * cos(angle.x), radius.x * sin(angle.x), radius.y * cos(angle.y));
}

/// v, turned by a quaternion (w, x, y, z) of length one.
fn turn(q: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    return v + 2.0 * cross(q.yzw, cross(q.yzw, v) + q.x * v);
}

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let slot = linear_thread(group, groups, lane);
    if slot >= arguments.count { return; }
    let entry = source[slot];
    if (entry & CHILD) == 0u { return; }
    var child = 0u;
    if slot > 0u && source[slot - 1u] == entry { child = 1u; }
    let shape = color_geometry[2u * slot + 1u];
    let q = color_geometry[2u * slot];
    let stream = hash(hash(2u * (entry & INDEX_MASK) + child) ^ hash(arguments.seed));
    let offset = turn(q / length(q), scales(shape.xyz) * normal(stream));
    if is_finite(offset.x) && is_finite(offset.y) && is_finite(offset.z) {
        means[slot] += vec4<f32>(offset, 0.0);
    }
    let shrink = vec4<f32>(vec3<f32>(SPLIT_SHRINK), 0.0);
    color_geometry[2u * slot + 1u] -= shrink;
    language_geometry[2u * slot + 1u] -= shrink;
}
