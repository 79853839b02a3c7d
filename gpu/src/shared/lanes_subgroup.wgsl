/// Lanes of a tile are one subgroup: values go from register to register, no barrier.

var<private> published: array<vec4<f32>, PUBLISHED>;
var<private> kept: array<vec4<f32>, LEFT>;

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

/// Adds this lane's share to a row of the record of a hit of the batch.
fn leave(hit: u32, row: u32, value: vec4<f32>, lane: u32) {
    var sum = value;
    //repeat step STEPS
    sum += subgroupShuffleXor(sum, 1u << $step);
    //end
    kept[row] = select(kept[row], sum, lane == hit);
}

/// A row of the record of hit `lane` of the batch, summed over the lanes.
fn record_row(row: u32, lane: u32) -> vec4<f32> {
    return kept[row];
}

/// The largest value of all lanes.
fn largest(value: u32, lane: u32) -> u32 {
    return subgroupMax(value);
}
