/// Visits the tiles that the Gaussian of a rank hits, in order, with slots from `first` up to
/// `end`; returns the first slot behind them. The kernel defines `visit`.
fn walk(rank: u32, first: u32, end: u32) -> u32 {
    let gaussian = gaussian_from_rank[rank];
    let covered = coverage_from_rank[rank];
    var slot = first;
    if covered.width > 0u {
        for (var rest = covered.mask; rest != 0u && slot < end; rest &= rest - 1u) {
            let at = firstTrailingBit(rest);
            let row = at / covered.width;
            let tile = covered.origin + row * (pass_.tiles.x - covered.width) + at;
            visit(tile, slot, gaussian);
            slot += 1u;
        }
    } else {
        let splat = splats[gaussian];
        let rect = tile_rect(splat);
        for (var y = rect.y; y < rect.w; y++) {
            let columns = touched_columns(splat, rect, y);
            for (var x = columns.x; x < columns.y; x++) {
                if slot < end && touches(splat, vec2<u32>(x, y)) {
                    visit(y * pass_.tiles.x + x, slot, gaussian);
                    slot += 1u;
                }
            }
        }
    }
    return slot;
}
