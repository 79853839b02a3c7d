// Back to front over a tile's list (Kerbl et al. 2023, appendix A). With g = dL/dimage, w = alpha T
// and B the light from behind a Gaussian: dL/dfeature = sum w g; dL/dalpha = T (feature - B) . g,
// where the scalar B . g is all that a pixel must carry. dL/dpower = alpha dL/dalpha, both 0 where
// alpha is skipped or clamped.
//
// The lanes' shares of a hit are added up in a fixed order and left as one record in the hit's own
// slot. With p = dL/dpower and d = centre - pixel the rows of a record are
//   0: sum p dx, sum p dy, sum p, sum w
//   1: sum p dx^2, sum p dx dy, sum p dy^2, 0
//   2 and on: dL/dfeature
// One dispatch takes CHUNK of ROWS feature rows; p is linear in them, so later ones add theirs.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> ranges: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> slot_from_sorted: array<u32>;
@group(0) @binding(3) var<storage, read> gaussian_from_sorted: array<u32>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
@group(0) @binding(5) var<storage, read> features: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> pixels: array<PixelState>;
@group(0) @binding(7) var<storage, read> gradients: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> records: array<vec4<f32>>;

const RECORD: u32 = 2u + ROWS;

/// State of the pixels of a lane.
var<private> transmittance: array<vec4<f32>, STRIPS>;
var<private> behind: array<vec4<f32>, STRIPS>; // B . g
var<private> last: array<vec4<u32>, STRIPS>;
var<private> gradient: array<vec4<f32>, 4 * CHUNK * STRIPS>; // channel by channel, four pixels each

fn load_pixels(corner: vec2<u32>, lane: u32) {
    //repeat s STRIPS
    {
        let origin = strip_origin(corner, lane, $s);
        let drawn = inside(origin, pass_.size);
        transmittance[$s] = vec4<f32>(1.0);
        for (var x = 0u; x < 4u; x++) {
            let pixel = origin.y * pass_.size.x + origin.x + x;
            if drawn[x] {
                transmittance[$s][x] = pixels[pixel].transmittance;
                last[$s][x] = pixels[pixel].last;
            }
            //repeat row CHUNK
            {
                let at = ($s * CHUNK + $row) * 4u;
                let row = pass_.chunk * CHUNK + $row;
                var g = vec4<f32>(0.0);
                if drawn[x] && row < ROWS { g = gradients[pixel * ROWS + row]; }
                gradient[at][x] = g.x;
                gradient[at + 1u][x] = g.y;
                gradient[at + 2u][x] = g.z;
                gradient[at + 3u][x] = g.w;
            }
            //end
        }
    }
    //end
}

/// One hit of the batch, which lane `other` published, at this lane's pixels.
fn add_hit(hit: u32, other: u32, corner: vec2<u32>, lane: u32) {
    let place = shared_row(0u, other);
    let form = shared_row(1u, other);
    var first = vec4<f32>(0.0);
    var second = vec4<f32>(0.0);
    var weights: array<vec4<f32>, STRIPS>;
    //repeat s STRIPS
    {
        let at_strip = footprint(place, form, vec2<f32>(strip_origin(corner, lane, $s)));
        let raw = select(vec4<f32>(0.0), at_strip.alpha, vec4<u32>(hit) < last[$s]);
        let alpha = min(raw, vec4<f32>(MAX_ALPHA));
        transmittance[$s] /= 1.0 - alpha;
        weights[$s] = alpha * transmittance[$s];
        var lit = vec4<f32>(0.0); // feature . g
        //repeat row CHUNK
        {
            let feature = shared_row(2u + $row, other);
            let g = ($s * CHUNK + $row) * 4u;
            lit += feature.x * gradient[g] + feature.y * gradient[g + 1u]
                + feature.z * gradient[g + 2u] + feature.w * gradient[g + 3u];
        }
        //end
        let ahead = lit - behind[$s];
        behind[$s] += alpha * ahead;
        let p = select(vec4<f32>(0.0), weights[$s] * ahead, raw < vec4<f32>(MAX_ALPHA));
        let total = dot(p, vec4<f32>(1.0));
        let along = dot(p, at_strip.dx);
        first += vec4<f32>(along, total * at_strip.dy, total, dot(weights[$s], vec4<f32>(1.0)));
        second += vec4<f32>(dot(p, at_strip.dx * at_strip.dx), along * at_strip.dy,
            total * at_strip.dy * at_strip.dy, 0.0);
    }
    //end
    accumulate(other, 0u, first, lane);
    accumulate(other, 1u, second, lane);
    //repeat row CHUNK
    {
        var sum = vec4<f32>(0.0);
        //repeat s STRIPS
        {
            let g = ($s * CHUNK + $row) * 4u;
            sum += vec4<f32>(dot(weights[$s], gradient[g]), dot(weights[$s], gradient[g + 1u]),
                dot(weights[$s], gradient[g + 2u]), dot(weights[$s], gradient[g + 3u]));
        }
        //end
        accumulate(other, 2u + $row, sum, lane);
    }
    //end
}

/// Writes the record, summed over the lanes, of this lane's hit of the batch.
fn store_record(slot: u32, lane: u32) {
    let first = record_row(0u, lane);
    let second = record_row(1u, lane);
    if pass_.chunk == 0u {
        records[slot * RECORD] = first;
        records[slot * RECORD + 1u] = second;
    } else {
        records[slot * RECORD] += vec4<f32>(first.xyz, 0.0);
        records[slot * RECORD + 1u] += second;
    }
    //repeat row CHUNK
    {
        let row = pass_.chunk * CHUNK + $row;
        if row < ROWS { records[slot * RECORD + 2u + row] = record_row(2u + $row, lane); }
    }
    //end
}

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = pass_.band.x * pass_.tiles.x + linear_group(group, groups);
    if tile >= pass_.band.y * pass_.tiles.x { return; }
    let corner = vec2<u32>(tile % pass_.tiles.x, tile / pass_.tiles.x);
    let range = ranges[tile];
    load_pixels(corner, lane);
    var end = 0u;
    //repeat s STRIPS
    end = max(end, max(max(last[$s].x, last[$s].y), max(last[$s].z, last[$s].w)));
    //end
    var stop = max(largest(end, lane), range.x);
    if pass_.chunk == 0u {
        for (var hit = stop + lane; hit < range.y; hit += LANES) {
            let record = slot_from_sorted[hit] * RECORD;
            for (var row = 0u; row < RECORD; row++) { records[record + row] = vec4<f32>(0.0); }
        }
    }
    while stop > range.x {
        let start = max(stop, range.x + BATCH) - BATCH;
        publish_hits(start, stop, lane);
        sync_lanes();
        //repeat j BATCH
        add_hit(start + BATCH - 1u - $j, BATCH - 1u - $j, corner, lane);
        //end
        sync_lanes();
        if lane < stop - start { store_record(slot_from_sorted[start + lane], lane); }
        stop = start;
    }
}
