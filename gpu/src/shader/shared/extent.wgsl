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

/// Columns of a row of tiles outside of which the splat touches none: first, end. They bound the ellipse
/// conic <= reach within the row, whose left and right borders are convex. The bound of `touches` is wider
/// than the ellipse by what rounding may hide.
fn touched_columns(splat: Splat, rect: vec4<u32>, row: u32) -> vec2<u32> {
    let conic = conic_of_splat(splat);
    let far = splat.extent + TILE_SIZE;
    let hidden = 1e-5 * (conic.x * far.x * far.x + conic.z * far.y * far.y);
    let reach = splat.form.w * 1.001 + 0.01 + hidden;
    // 4 xx yy - xy^2 without its cancellation.
    let round = 4.0 * splat.place.z * splat.form.x;
    let low = f32(row) * TILE_SIZE.y - splat.place.y;
    let high = low + TILE_SIZE.y - 1.0;
    // Where the ellipse is farthest to the left; to the right it is the opposite.
    let extreme = conic.y * sqrt(reach / (round * conic.z));
    let y = clamp(vec2<f32>(extreme, -extreme), vec2<f32>(low), vec2<f32>(high));
    let half = sqrt(max(4.0 * conic.x * reach - round * y * y, vec2<f32>(0.0)));
    let x = (-conic.y * y + vec2<f32>(-1.0, 1.0) * half) / (2.0 * conic.x) + splat.place.x;
    let slack = 0.5 + 1e-3 * splat.extent.x;
    let columns = floor((x + vec2<f32>(-slack, slack)) / TILE_SIZE.x) + vec2<f32>(0.0, 1.0);
    let inside = clamp(columns, vec2<f32>(f32(rect.x)), vec2<f32>(f32(rect.z)));
    let all = vec2<f32>(f32(rect.x), f32(rect.z));
    // A number that is not finite bounds nothing.
    let is_known = columns.x <= columns.y;
    return vec2<u32>(select(all, inside, is_known));
}
