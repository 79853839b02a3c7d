/// Scales, in metres.
fn scales(log_scale: vec3<f32>) -> vec3<f32> {
    return exp(clamp(log_scale, vec3<f32>(-LOG_SCALE_LIMIT), vec3<f32>(LOG_SCALE_LIMIT)));
}
