/// A lane owns STRIPS strips of four neighbouring pixels in one row of its tile.

/// Leftmost pixel of a strip.
fn strip_origin(tile: vec2<u32>, lane: u32, strip: u32) -> vec2<u32> {
    let column = (lane % COLUMNS) * STRIPS + strip;
    return tile * vec2<u32>(TILE_WIDTH, TILE_HEIGHT) + vec2<u32>(4u * column, lane / COLUMNS);
}

/// Which of the four pixels of a strip lie in the image.
fn inside(origin: vec2<u32>, size: vec2<u32>) -> vec4<bool> {
    let column = vec4<u32>(origin.x) + vec4<u32>(0u, 1u, 2u, 3u);
    return (column < vec4<u32>(size.x)) & vec4<bool>(origin.y < size.y);
}

/// One Gaussian at the four pixels of a strip.
struct Footprint {
    /// Centre minus pixel.
    dx: vec4<f32>,
    dy: f32,
    /// opacity exp(-q / 2), q the squared Mahalanobis distance; 0 where it is below MIN_ALPHA.
    alpha: vec4<f32>,
}

/// `place` and `form` are rows of a Splat; its squares and opacity are exponents of 2.
fn footprint(place: vec4<f32>, form: vec4<f32>, origin: vec2<f32>) -> Footprint {
    let dx = vec4<f32>(place.x - origin.x) - vec4<f32>(0.0, 1.0, 2.0, 3.0);
    let dy = place.y - origin.y;
    let off = vec4<f32>(dy) - place.w * dx;
    let power = vec4<f32>(form.y) - place.z * dx * dx - form.x * off * off;
    let alpha = exp2(power);
    return Footprint(dx, dy, select(vec4<f32>(0.0), alpha, alpha >= vec4<f32>(MIN_ALPHA)));
}
