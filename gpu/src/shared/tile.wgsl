/// A thread owns STRIPS strips of four neighbouring pixels in one row of its tile.

/// Leftmost pixel of a strip.
fn strip_origin(tile: vec2<u32>, lane: u32, strip: u32) -> vec2<u32> {
    return tile * TILE + vec2<u32>((lane % 2u) * 8u + strip * 4u, lane / 2u);
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
    /// exp(-(A dx^2 + C dy^2) / 2 - B dx dy)
    gauss: vec4<f32>,
    /// min(MAX_ALPHA, opacity gauss), 0 where it is skipped.
    alpha: vec4<f32>,
}

fn footprint(splat: Splat, origin: vec2<u32>) -> Footprint {
    let dx = vec4<f32>(splat.mean.x - f32(origin.x)) - vec4<f32>(0.0, 1.0, 2.0, 3.0);
    let dy = splat.mean.y - f32(origin.y);
    let power = -0.5 * (splat.conic.x * dx * dx + vec4<f32>(splat.conic.z * dy * dy))
        - splat.conic.y * dy * dx;
    let gauss = exp(power);
    let alpha = min(vec4<f32>(MAX_ALPHA), splat.opacity * gauss);
    let drawn = (power <= vec4<f32>(0.0)) & (alpha >= vec4<f32>(MIN_ALPHA));
    return Footprint(dx, dy, gauss, select(vec4<f32>(0.0), alpha, drawn));
}
