/// Exchange between the lanes of a tile through workgroup memory, which every adapter has.

var<workgroup> published: array<vec4<f32>, PUBLISHED * BATCH>;
var<workgroup> partial: array<vec4<f32>, RECORD_ROWS * BATCH * LANES>;
var<workgroup> votes: array<u32, LANES>;
var<workgroup> winner: u32;

/// Offers a row to the other lanes; only those that load a hit of the batch have one.
fn publish(row: u32, value: vec4<f32>, lane: u32) {
    if lane < BATCH { published[row * BATCH + lane] = value; }
}

/// Waits until all lanes have published or accumulated.
fn sync_lanes() {
    workgroupBarrier();
}

/// The row that another lane published.
fn shared_row(row: u32, other: u32) -> vec4<f32> {
    return published[row * BATCH + other];
}

/// Adds this lane's value to a row of the record of a hit of the batch.
fn accumulate(hit: u32, row: u32, value: vec4<f32>, lane: u32) {
    partial[(hit * RECORD_ROWS + row) * LANES + lane] = value;
}

/// A row of the record of hit `lane` of the batch, summed over the lanes.
fn record_row(row: u32, lane: u32) -> vec4<f32> {
    var sum = vec4<f32>(0.0);
    for (var other = 0u; other < LANES; other++) {
        sum += partial[(lane * RECORD_ROWS + row) * LANES + other];
    }
    return sum;
}

/// The largest value of all lanes.
fn largest(value: u32, lane: u32) -> u32 {
    votes[lane] = value;
    workgroupBarrier();
    if lane == 0u {
        var most = 0u;
        for (var other = 0u; other < LANES; other++) { most = max(most, votes[other]); }
        winner = most;
    }
    return workgroupUniformLoad(&winner);
}
