/// Brightness of a color (Rec. 601).
fn luma(rgb: vec3<f32>) -> f32 {
    return dot(rgb, vec3<f32>(LUMA_RED, LUMA_GREEN, LUMA_BLUE));
}

/// The depth, or 0 if it is not a positive number.
fn measured(depth: f32) -> f32 {
    return select(0.0, depth, depth > 0.0 && is_finite(depth));
}
