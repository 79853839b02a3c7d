/// Which tiles of the band the splat hits. Tiles that are left out count only in rectangles that are too
/// large for a mask. The kernel binds `left_out`.
fn covered(splat: Splat) -> Coverage {
    let rect = tile_rect(splat);
    let has_mask = (rect.z - rect.x) * (rect.w - rect.y) <= MASK_TILES;
    var found = vec2<u32>(0u);
    var at = 0u;
    for (var y = rect.y; y < rect.w; y++) {
        for (var x = rect.x; x < rect.z; x++) {
            var hit = u32(touches(splat, vec2<u32>(x, y)));
            if has_mask && left_out[y * pass_.tiles.x + x] != 0u { hit = 0u; }
            found += vec2<u32>(hit, hit << min(at, MASK_TILES - 1u));
            at += 1u;
        }
    }
    let width = select(0u, rect.z - rect.x, has_mask);
    return Coverage(found.x, found.y, rect.y * pass_.tiles.x + rect.x, width);
}
