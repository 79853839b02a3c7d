// The parameters of one visible Gaussian; see mod.rs for the formula.

@group(0) @binding(0) var<uniform> arguments: AdamArguments;
@group(0) @binding(1) var<storage, read> gaussian_from_visible: array<u32>;
@group(0) @binding(2) var<storage, read> gradients: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> corrections: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read_write> values: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> first: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> second: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let index = linear_thread(group, groups, lane);
    if index >= arguments.count { return; }
    let correction = corrections[index];
    if !(correction.x > 0.0) { return; }
    let gaussian = gaussian_from_visible[index];
    for (var part = 0u; part < arguments.rows; part++) {
        let row = gaussian * arguments.rows + part;
        let gradient = gradients[index * arguments.stride + part];
        let is_odd = part % 2u == 1u;
        let rates = select(arguments.even, arguments.odd, vec4<bool>(is_odd));
        let m = BETA_FIRST * first[row] + (1.0 - BETA_FIRST) * gradient;
        let v = BETA_SECOND * second[row] + (1.0 - BETA_SECOND) * gradient * gradient;
        var moved = values[row]
            - rates * m * correction.x / (sqrt(v * correction.y) + vec4<f32>(EPSILON));
        if is_odd {
            moved = vec4<f32>(min(moved.xyz, vec3<f32>(arguments.odd_at_most)), moved.w);
        }
        let sound = (abs(gradient) < vec4<f32>(MAX_GRADIENT)) & (abs(moved) < vec4<f32>(HUGE));
        first[row] = select(first[row], m, sound);
        second[row] = select(second[row], v, sound);
        values[row] = select(values[row], moved, sound);
    }
}
