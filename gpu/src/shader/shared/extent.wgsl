/// Width and height of a tile, in pixels.
const TILE_SIZE: vec2<f32> = vec2<f32>(f32(TILE_WIDTH), f32(TILE_HEIGHT));

/// Tiles of the band that the bounding box of the visible ellipse overlaps: first column, first row,
/// end column, end row.
fn tile_rect(splat: Splat) -> vec4<u32> {
    let first = vec2<f32>(0.0, f32(pass_.band.x));
    let end = vec2<f32>(f32(pass_.tiles.x), f32(pass_.band.y));
    let reach = splat.extent + vec2<f32>(0.01);
    let mean = splat.place.xy;
    let low = clamp(floor((mean - reach) / TILE_SIZE), first, end);
    let high = clamp(floor((mean + reach) / TILE_SIZE) + 1.0, first, end);
    return vec4<u32>(vec2<u32>(low), vec2<u32>(high));
}

/// xx x^2 + xy x y + yy y^2 less a bound on its rounding error.
fn distance_below(conic: vec3<f32>, d: vec2<f32>) -> f32 {
    let squares = conic.x * d.x * d.x + conic.z * d.y * d.y;
    return squares + conic.y * d.x * d.y - 1e-5 * squares;
}

/// True if alpha may reach MIN_ALPHA at a pixel of the tile: the least Mahalanobis distance over
/// the tile's rectangle of pixel centres is taken on the edges that face the centre.
fn touches(splat: Splat, tile: vec2<u32>) -> bool {
    let low = vec2<f32>(tile) * TILE_SIZE - splat.place.xy;
    let high = low + TILE_SIZE - 1.0;
    let conic = conic_of_splat(splat);
    let nearest = clamp(vec2<f32>(0.0), low, high);
    let y = clamp(-0.5 * conic.y * nearest.x / conic.z, low.y, high.y);
    let x = clamp(-0.5 * conic.y * nearest.y / conic.x, low.x, high.x);
    let least = min(
        distance_below(conic, vec2<f32>(nearest.x, y)),
        distance_below(conic, vec2<f32>(x, nearest.y)),
    );
    return least <= splat.form.w * 1.001 + 0.01;
}
