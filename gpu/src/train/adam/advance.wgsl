// t += 1 where a pixel saw the Gaussian; corrections = gain(t)/(1 - b1^t), 1/(1 - b2^t), else 0, with
// gain(t) = 1 + (first_rate - 1) exp(-(t - 1) / young_steps).

@group(0) @binding(0) var<uniform> arguments: AdvanceArguments;
@group(0) @binding(1) var<storage, read> gaussian_from_visible: array<u32>;
@group(0) @binding(2) var<storage, read> sums: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> one: array<HitCount>;
@group(0) @binding(4) var<storage, read> other: array<HitCount>;
@group(0) @binding(5) var<storage, read_write> steps: array<u32>;
@group(0) @binding(6) var<storage, read_write> corrections: array<vec2<f32>>;

/// 1 - exp(x) for negative x. Near 0 it is a series: the difference would keep the rounding of exp,
/// which is another one on each driver, and lose the digits that count.
fn decayed(x: vec2<f32>) -> vec2<f32> {
    let series = x / 2.0 * (1.0 + x / 3.0 * (1.0 + x / 4.0 * (1.0 + x / 5.0 * (1.0 + x / 6.0))));
    return select(1.0 - exp(x), -x * (1.0 + series), x > vec2<f32>(-0.25));
}

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let index = linear_thread(group, groups, lane);
    if index >= arguments.count { return; }
    let whole = one[0].missing == 0u && other[0].missing == 0u;
    corrections[index] = vec2<f32>(0.0);
    if whole && sums[arguments.rows * index].w > 0.0 {
        let gaussian = gaussian_from_visible[index];
        let t = steps[gaussian] + 1u;
        steps[gaussian] = t;
        let youth = exp(-f32(t - 1u) / arguments.young_steps);
        let gain = vec2<f32>(1.0 + (arguments.first_rate - 1.0) * youth, 1.0);
        corrections[index] = gain / decayed(f32(t) * vec2<f32>(LOG_BETA_FIRST, LOG_BETA_SECOND));
    }
}
