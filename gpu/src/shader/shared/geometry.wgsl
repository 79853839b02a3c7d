/// Rotation of a quaternion (w, x, y, z) of length one.
fn rotation(q: vec4<f32>) -> mat3x3<f32> {
    let w = q.x; let x = q.y; let y = q.z; let z = q.w;
    return mat3x3<f32>(
        vec3<f32>(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        vec3<f32>(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        vec3<f32>(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    );
}

/// Rotation part of camera_from_world.
fn camera_rotation() -> mat3x3<f32> {
    return transpose(mat3x3<f32>(pass_.camera_x.xyz, pass_.camera_y.xyz, pass_.camera_z.xyz));
}

/// A world point in the camera.
fn camera_point(mean: vec3<f32>) -> vec3<f32> {
    let p = vec4<f32>(mean, 1.0);
    return vec3<f32>(dot(pass_.camera_x, p), dot(pass_.camera_y, p), dot(pass_.camera_z, p));
}

/// x/z and y/z, clamped for the Jacobian.
fn clamped_slope(p: vec3<f32>) -> vec2<f32> {
    return clamp(p.xy / p.z, -pass_.limit, pass_.limit);
}

/// Square root of the projected covariance: Sigma = rows rows^T with rows = J W R S (EWA).
struct Root {
    x: vec3<f32>,
    y: vec3<f32>,
}

fn projected_root(p: vec3<f32>, camera_from_local: mat3x3<f32>) -> Root {
    let slope = clamped_slope(p);
    let local_from_camera = transpose(camera_from_local);
    let x = vec3<f32>(pass_.focal.x, 0.0, -pass_.focal.x * slope.x) / p.z;
    let y = vec3<f32>(0.0, pass_.focal.y, -pass_.focal.y * slope.y) / p.z;
    return Root(local_from_camera * x, local_from_camera * y);
}

/// Dilated covariance in the image, xx xy yy, and its determinant without cancellation:
/// |x cross y|^2 + DILATION (|x|^2 + |y|^2) + DILATION^2.
fn covariance(root: Root) -> vec4<f32> {
    let xx = dot(root.x, root.x);
    let yy = dot(root.y, root.y);
    let area = cross(root.x, root.y);
    let determinant = dot(area, area) + DILATION * (xx + yy) + DILATION * DILATION;
    return vec4<f32>(xx + DILATION, dot(root.x, root.y), yy + DILATION, determinant);
}

/// Inverse of the covariance: xx, xy, yy.
fn conic_of(covariance: vec4<f32>) -> vec3<f32> {
    return vec3<f32>(covariance.z, -covariance.y, covariance.x) / covariance.w;
}
