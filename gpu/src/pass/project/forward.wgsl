// Projection of a Gaussian into a camera (EWA): u = fx x/z + cx, Sigma2 = J W Sigma W^T J^T +
// DILATION. Whatever cannot be drawn, NaN included, gets no hits. The first dispatch takes the first
// band, and each further one adds the hits of its own.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> means: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> features: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> left_out: array<u32>;
@group(0) @binding(5) var<storage, read_write> splats: array<Splat>;
@group(0) @binding(6) var<storage, read_write> coverage: array<Coverage>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let gaussian = linear_thread(group, groups, lane);
    if gaussian >= pass_.count { return; }
    if pass_.band.x == 0u { coverage[gaussian] = Coverage(0u, 0u, 0u, 0u); }
    let shape = geometry[2u * gaussian + 1u];
    let q = geometry[2u * gaussian];
    let p = camera_point(means[gaussian].xyz);
    let norm = length(q);
    let opacity = 1.0 / (1.0 + exp(-shape.w));
    let usable = p.z > NEAR && p.z < FAR && norm > 1e-12 && norm < HUGE && opacity >= MIN_ALPHA
        && is_finite(p.x) && is_finite(p.y)
        && is_finite(shape.x) && is_finite(shape.y) && is_finite(shape.z);
    if !usable { return; }
    let s = scales(shape.xyz);
    var camera_from_local = camera_rotation() * rotation(q / norm);
    camera_from_local[0] *= s.x;
    camera_from_local[1] *= s.y;
    camera_from_local[2] *= s.z;
    let sigma = covariance(projected_root(p, camera_from_local));
    let mean = pass_.focal * p.xy / p.z + pass_.centre;
    let drawable = sigma.w > 0.0 && sigma.w < HUGE && is_finite(sigma.x) && is_finite(sigma.z)
        && is_finite(mean.x) && is_finite(mean.y);
    if !drawable { return; }
    // exp(-q / 2) = 2^(-q BITS / 2)
    let reach = max(log2(opacity / MIN_ALPHA), 0.0);
    let extent = sqrt(2.0 * reach / BITS_PER_NAT * sigma.xz);
    // q = x^2 / Sigma_xx + (y - lean x)^2 Sigma_xx / det: squares, which cannot cancel as the
    // conic's three terms do for a long thin splat.
    let lean = sigma.y / sigma.x;
    let squares = 0.5 * BITS_PER_NAT * vec2<f32>(1.0 / sigma.x, sigma.x / sigma.w);
    let place = vec4<f32>(mean, squares.x, lean);
    let form = vec4<f32>(squares.y, log2(opacity), p.z, reach);
    var feature = vec4<f32>(0.0);
    if COLOR { feature = vec4<f32>(features[gaussian].xyz, p.z); }
    let splat = Splat(place, form, feature, extent, vec2<f32>(0.0));
    splats[gaussian] = splat;
    let hits_above = coverage[gaussian].hits;
    coverage[gaussian] = covered(splat);
    coverage[gaussian].hits += hits_above;
}
