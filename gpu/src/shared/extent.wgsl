/// Tiles that the bounding box of the visible ellipse meets: first column, first row, end, end.
fn tile_rect(splat: Splat) -> vec4<u32> {
    let tiles = vec2<f32>(pass_.tiles);
    let reach = splat.extent + vec2<f32>(0.01);
    let low = clamp(floor((splat.mean - reach) / f32(TILE)), vec2<f32>(0.0), tiles);
    let high = clamp(floor((splat.mean + reach) / f32(TILE)) + 1.0, vec2<f32>(0.0), tiles);
    return vec4<u32>(vec2<u32>(low), vec2<u32>(high));
}

/// A x^2 + 2 B x y + C y^2 less a bound on its rounding error.
fn distance_below(conic: vec3<f32>, d: vec2<f32>) -> f32 {
    let squares = conic.x * d.x * d.x + conic.z * d.y * d.y;
    return squares + 2.0 * conic.y * d.x * d.y - 1e-5 * squares;
}

/// True if alpha may reach MIN_ALPHA at a pixel of the tile: the least Mahalanobis distance over
/// the tile's square of pixel centres is taken on the edges that face the centre.
fn touches(splat: Splat, tile: vec2<u32>) -> bool {
    let low = vec2<f32>(tile * TILE) - splat.mean;
    let high = low + f32(TILE - 1u);
    let nearest = clamp(vec2<f32>(0.0), low, high);
    let y = clamp(-splat.conic.y * nearest.x / splat.conic.z, low.y, high.y);
    let x = clamp(-splat.conic.y * nearest.y / splat.conic.x, low.x, high.x);
    let least = min(
        distance_below(splat.conic, vec2<f32>(nearest.x, y)),
        distance_below(splat.conic, vec2<f32>(x, nearest.y)),
    );
    return least <= splat.reach * 1.001 + 0.01;
}
