/// Exchange between the lanes of a tile that is one subgroup: through registers, without a barrier.

var<private> published: array<vec4<f32>, PUBLISHED>;
var<private> summed: array<vec4<f32>, RECORD_ROWS>;
var<private> waiting: array<vec4<f32>, RECORD_ROWS * FOLDS>;

/// Offers a row to the other lanes.
fn publish(row: u32, value: vec4<f32>, lane: u32) {
    published[row] = value;
}

/// Waits until all lanes have published or accumulated; needs nothing inside a subgroup.
fn sync_lanes() {}

/// The row that another lane published.
fn shared_row(row: u32, other: u32) -> vec4<f32> {
    return subgroupShuffle(published[row], other);
}

/// One exchange of a butterfly sum over two rows, of an even and of an odd hit: lanes with the bit
/// go on with the sum of the odd hit, the others with that of the even hit.
fn fold(even: vec4<f32>, odd: vec4<f32>, bit: u32, lane: u32) -> vec4<f32> {
    let upper = (lane & bit) != 0u;
    return select(even, odd, upper) + subgroupShuffleXor(select(odd, even, upper), bit);
}

/// Adds this lane's value to a row of the record of a hit of the batch. It must be called for every
/// hit of the batch in order, the last one first if DESCENDING. Hits are folded in pairs, so that
/// in the end each lane holds the sum of one hit, with less than one exchange per row.
fn accumulate(hit: u32, row: u32, value: vec4<f32>, lane: u32) {
    var sum = value;
    //repeat level FOLDS
    {
        let bit = 1u << $level;
        let at = row * FOLDS + $level;
        if ((hit & bit) != 0u) == DESCENDING {
            waiting[at] = sum;
            return;
        }
        if DESCENDING {
            sum = fold(sum, waiting[at], bit, lane);
        } else {
            sum = fold(waiting[at], sum, bit, lane);
        }
    }
    //end
    //repeat step STEPS
    sum += subgroupShuffleXor(sum, BATCH << $step);
    //end
    summed[row] = sum;
}

/// A row of the record of hit `lane` of the batch, summed over the lanes.
fn record_row(row: u32, lane: u32) -> vec4<f32> {
    return summed[row];
}

/// The largest value of all lanes.
fn largest(value: u32, lane: u32) -> u32 {
    return subgroupMax(value);
}
