/// Brightness of a color (Rec. 601).
fn luma(rgb: vec3<f32>) -> f32 {
    return dot(rgb, vec3<f32>(LUMA_RED, LUMA_GREEN, LUMA_BLUE));
}

/// pixel / width. Software drivers divide integers one by one.
fn row_of(pixel: u32, width: u32) -> u32 {
    let row = u32(f32(pixel) / f32(width));
    let above = select(row, row - 1u, row * width > pixel);
    return select(above, above + 1u, pixel - above * width >= width);
}

/// The depth, or 0 if it is not a positive number.
fn measured(depth: f32) -> f32 {
    return select(0.0, depth, depth > 0.0 && is_finite(depth));
}
