// From the summed records of a Gaussian to its parameters and to the pose (Kerbl et al. 2023,
// appendix A). With conic K, Sigma = K^-1:
//   dL/dmean2 = -(A sx + B sy, B sx + C sy), dL/dK = -(sxx, sxy, syy) / 2 as a symmetric matrix,
//   dL/dSigma = -K dL/dK K, and Sigma = X X^T with X = J W R S gives the rest by the chain rule.
// Pose, by a left perturbation of camera_from_world, p -> p + rho + theta x p: dL/drho = dL/dp and
// dL/dtheta = p x dL/dp + sum over the columns v of V = W R S of v x dL/dv.
// Language (not COLOR) leaves mean and pose alone.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> gaussian_from_visible: array<u32>;
@group(0) @binding(2) var<storage, read> means: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> sums: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> moves: array<vec4<f32>>; // dL/d(mean, rho, theta)
@group(0) @binding(6) var<storage, read_write> geometry_gradients: array<vec4<f32>>;

/// dL/dq of a quaternion of length one from dL/dR.
fn rotation_gradient(q: vec4<f32>, g: mat3x3<f32>) -> vec4<f32> {
    let w = q.x; let x = q.y; let y = q.z; let z = q.w;
    // g[j][i] is dL/dR_ij.
    let skew = vec3<f32>(g[1][2] - g[2][1], g[2][0] - g[0][2], g[0][1] - g[1][0]);
    let xy = g[0][1] + g[1][0];
    let xz = g[0][2] + g[2][0];
    let yz = g[1][2] + g[2][1];
    return 2.0 * vec4<f32>(
        dot(skew, vec3<f32>(x, y, z)),
        y * xy + z * xz + w * skew.x - 2.0 * x * (g[1][1] + g[2][2]),
        x * xy + z * yz + w * skew.y - 2.0 * y * (g[0][0] + g[2][2]),
        x * xz + y * yz + w * skew.z - 2.0 * z * (g[0][0] + g[1][1]),
    );
}

/// dL/dp of the camera point: through the mean in the image, through depth and through J.
fn point_gradient(p: vec3<f32>, mean: vec2<f32>, depth: f32, jx: vec3<f32>,
                  jy: vec3<f32>) -> vec3<f32> {
    let f = pass_.focal;
    let z2 = p.z * p.z;
    var g = vec3<f32>(mean * f / p.z, depth - dot(mean * f, p.xy) / z2);
    let slope = clamped_slope(p);
    g.z += (-f.x * jx.x - f.y * jy.y + f.x * slope.x * jx.z + f.y * slope.y * jy.z) / z2;
    let d_slope = -vec2<f32>(f.x * jx.z, f.y * jy.z) / p.z;
    let free = select(vec2<f32>(0.0), d_slope, abs(p.xy / p.z) < pass_.limit);
    return g + vec3<f32>(free / p.z, -dot(free, p.xy) / z2);
}

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let index = linear_thread(group, groups, lane);
    if index >= pass_.count { return; }
    geometry_gradients[2u * index] = vec4<f32>(0.0);
    geometry_gradients[2u * index + 1u] = vec4<f32>(0.0);
    if COLOR {
        for (var row = 0u; row < 3u; row++) { moves[3u * index + row] = vec4<f32>(0.0); }
    }
    let first = sums[SUMS * index];
    let second = sums[SUMS * index + 1u];
    if !(first.w > 0.0) { return; }

    let gaussian = gaussian_from_visible[index];
    let q = geometry[2u * gaussian];
    let shape = geometry[2u * gaussian + 1u];
    let p = camera_point(means[gaussian].xyz);
    let norm = length(q);
    let unit = q / norm;
    let s = scales(shape.xyz);
    let local = rotation(unit);
    let scaled = mat3x3<f32>(local[0] * s.x, local[1] * s.y, local[2] * s.z);
    let camera = camera_rotation();
    let camera_from_local = camera * scaled;
    let root = projected_root(p, camera_from_local);
    let conic = conic_of(covariance(root));

    // dL/dSigma = -K dL/dK K with dL/dK = -(sxx, sxy; sxy, syy) / 2.
    let k = mat2x2<f32>(conic.x, conic.y, conic.y, conic.z);
    let d_sigma = 0.5 * k * mat2x2<f32>(second.x, second.y, second.y, second.z) * k;
    let d_root_x = 2.0 * (d_sigma[0][0] * root.x + d_sigma[0][1] * root.y);
    let d_root_y = 2.0 * (d_sigma[0][1] * root.x + d_sigma[1][1] * root.y);

    // Row i of X is V^T j_i with V = W R S.
    let slope = clamped_slope(p);
    let x = vec3<f32>(pass_.focal.x, 0.0, -pass_.focal.x * slope.x) / p.z;
    let y = vec3<f32>(0.0, pass_.focal.y, -pass_.focal.y * slope.y) / p.z;
    let local_x = transpose(camera) * x;
    let local_y = transpose(camera) * y;
    // dL/d(R S), column by column.
    var d_rotation: mat3x3<f32>;
    var d_scale: vec3<f32>;
    var d_theta: vec3<f32>;
    for (var j = 0u; j < 3u; j++) {
        let d_column = local_x * d_root_x[j] + local_y * d_root_y[j];
        d_scale[j] = dot(d_column, local[j]) * s[j];
        d_rotation[j] = d_column * s[j];
        d_theta += cross(camera_from_local[j], x * d_root_x[j] + y * d_root_y[j]);
    }
    let bounded = abs(shape.xyz) < vec3<f32>(LOG_SCALE_LIMIT);
    let d_unit = rotation_gradient(unit, d_rotation);
    let opacity = 1.0 / (1.0 + exp(-shape.w));
    geometry_gradients[2u * index] = (d_unit - unit * dot(unit, d_unit)) / norm;
    geometry_gradients[2u * index + 1u] = vec4<f32>(
        select(vec3<f32>(0.0), d_scale, bounded),
        first.z * (1.0 - opacity),
    );
    if COLOR {
        let d_mean = -vec2<f32>(dot(conic.xy, first.xy), dot(conic.yz, first.xy));
        let jx = camera_from_local * d_root_x;
        let jy = camera_from_local * d_root_y;
        let depth = sums[SUMS * index + 2u].x;
        let d_point = point_gradient(p, d_mean, depth, jx, jy);
        moves[3u * index] = vec4<f32>(transpose(camera) * d_point, 0.0);
        moves[3u * index + 1u] = vec4<f32>(d_point, 0.0);
        moves[3u * index + 2u] = vec4<f32>(d_theta + cross(p, d_point), 0.0);
    }
}
