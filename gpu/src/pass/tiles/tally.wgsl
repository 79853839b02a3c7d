/// The hits of this band, on top of what was counted of the bands above.
fn tally(above: HitCount) -> HitCount {
    let found = slot_from_rank[pass_.count];
    let drawn = min(found, pass_.capacity);
    let first = pass_.band.x == 0u;
    let view = min(found, 0xffffffffu / pass_.bands) * pass_.bands;
    let wanted = max(view, select(above.wanted, 0u, first));
    let missing = found - drawn + select(above.missing, 0u, first);
    return HitCount(drawn, wanted, missing, groups_for(drawn));
}
