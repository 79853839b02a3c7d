/// Lanes of a tile are one subgroup: values go from register to register, no barrier.

var<private> published: array<vec4<f32>, PUBLISHED>;
var<private> kept: array<vec4<f32>, LEFT>;
var<private> waiting: array<vec4<f32>, LEFT * FOLDS>;

/// Offers a row to the other lanes.
fn publish(row: u32, value: vec4<f32>, lane: u32) {
    published[row] = value;
}

/// All lanes have published, or left, what they have.
fn meet() {}

/// What another lane published.
fn shared_row(row: u32, other: u32) -> vec4<f32> {
    return subgroupShuffle(published[row], other);
}

/// Of two rows, of an even and of an odd hit, lanes with the bit take up the odd one's sum, the others
/// the even one's.
fn fold(even: vec4<f32>, odd: vec4<f32>, bit: u32, lane: u32) -> vec4<f32> {
    let upper = (lane & bit) != 0u;
    return select(even, odd, upper) + subgroupShuffleXor(select(odd, even, upper), bit);
}

/// Adds this lane's share to a row of the record of a hit of the batch. Hits must come in order, all
/// of the batch, the last first if DESCENDING. Two by two they are folded, so that in the end each
/// lane holds the sum of one hit, for less than one exchange per row.
fn leave(hit: u32, row: u32, value: vec4<f32>, lane: u32) {
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
    kept[row] = sum;
}

/// A row of the record of hit `lane` of the batch, summed over the lanes.
fn record_row(row: u32, lane: u32) -> vec4<f32> {
    return kept[row];
}

/// The largest value of all lanes.
fn largest(value: u32, lane: u32) -> u32 {
    return subgroupMax(value);
}
