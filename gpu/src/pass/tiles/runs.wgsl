/// The first rank whose hits begin at `slot` or behind.
fn rank_at(slot: u32) -> u32 {
    var low = 0u;
    var high = pass_.count;
    while low < high {
        let middle = (low + high) / 2u;
        if slot_from_rank[middle] < slot { low = middle + 1u; } else { high = middle; }
    }
    return low;
}

/// Visits all hits of a run: of the ranks whose hits begin in its share of the slots.
fn walk_run(run: u32) {
    let drawn = min(slot_from_rank[pass_.count], pass_.capacity);
    let length = (drawn + pass_.runs - 1u) / pass_.runs;
    let last = rank_at(min(run * length + length, drawn));
    for (var rank = rank_at(min(run * length, drawn)); rank < last; rank++) {
        let first = slot_from_rank[rank];
        let end = min(slot_from_rank[rank + 1u], pass_.capacity);
        if first < end { walk(rank, first, end); }
    }
}
