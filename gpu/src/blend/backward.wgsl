// Back to front over a tile's list (Kerbl et al. 2023, appendix A). With g = dL/dimage, w = alpha T
// and B the light from behind a Gaussian: dL/dfeature = sum w g; dL/dalpha = T (feature - B) . g,
// where the scalar B . g is all that a pixel must carry. dL/dpower = alpha dL/dalpha, both 0 where
// alpha is skipped or clamped.
//
// Threads work on a batch of hits, each for its own pixels, and leave their sums in workgroup
// memory; then they add these up, in a fixed order, into one record per hit slot. With
// p = dL/dpower and d = centre - pixel the rows of a record are
//   0: sum p dx, sum p dy, sum gauss dL/dalpha, sum w
//   1: sum p dx^2, sum p dx dy, sum p dy^2, 0
//   2 and on: dL/dfeature

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> ranges: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> gaussian_from_sorted: array<u32>;
@group(0) @binding(3) var<storage, read> slot_from_sorted: array<u32>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
@group(0) @binding(5) var<storage, read> features: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> pixels: array<PixelState>;
@group(0) @binding(7) var<storage, read> gradients: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> records: array<vec4<f32>>;

const RECORD: u32 = 2u + ROWS;

var<workgroup> partial: array<vec4<f32>, BATCH * RECORD * LANES>;
var<workgroup> ends: array<u32, LANES>;
var<workgroup> last_end: u32;

/// What a thread knows of its pixels.
var<private> transmittance: array<vec4<f32>, STRIPS>;
var<private> behind: array<vec4<f32>, STRIPS>; // B . g
var<private> last: array<vec4<u32>, STRIPS>;
var<private> gradient: array<vec4<f32>, STRIPS * CHANNELS>; // channel by channel, four pixels each

fn load_pixels(corner: vec2<u32>, lane: u32) {
    //repeat s STRIPS
    {
        let origin = strip_origin(corner, lane, $s);
        let drawn = inside(origin, pass_.size);
        transmittance[$s] = vec4<f32>(1.0);
        last[$s] = vec4<u32>(0u);
        behind[$s] = vec4<f32>(0.0);
        for (var x = 0u; x < 4u; x++) {
            let pixel = origin.y * pass_.size.x + origin.x + x;
            if drawn[x] {
                transmittance[$s][x] = pixels[pixel].transmittance;
                last[$s][x] = pixels[pixel].last;
            }
            //repeat row ROWS
            {
                let at = $s * CHANNELS + 4u * $row;
                var g = vec4<f32>(0.0);
                if drawn[x] { g = gradients[pixel * ROWS + $row]; }
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

/// One Gaussian at this thread's pixels, left in `partial` from `at` on, LANES apart.
fn add_hit(hit: u32, corner: vec2<u32>, lane: u32, at: u32) {
    let gaussian = gaussian_from_sorted[hit];
    let splat = splats[gaussian];
    var first = vec4<f32>(0.0);
    var second = vec4<f32>(0.0);
    var weights: array<vec4<f32>, STRIPS>;
    //repeat s STRIPS
    {
        let at_strip = footprint(splat, strip_origin(corner, lane, $s));
        let blended = (vec4<u32>(hit) < last[$s]) & (at_strip.alpha > vec4<f32>(0.0));
        let alpha = select(vec4<f32>(0.0), at_strip.alpha, blended);
        transmittance[$s] /= 1.0 - alpha;
        weights[$s] = alpha * transmittance[$s];
        var lit = vec4<f32>(0.0); // feature . g
        //repeat row ROWS
        {
            let feature = feature_of(gaussian, $row, splat.depth);
            let g = $s * CHANNELS + 4u * $row;
            lit += feature.x * gradient[g] + feature.y * gradient[g + 1u]
                + feature.z * gradient[g + 2u] + feature.w * gradient[g + 3u];
        }
        //end
        let free = blended & (at_strip.alpha < vec4<f32>(MAX_ALPHA));
        let d_alpha = select(vec4<f32>(0.0), transmittance[$s] * (lit - behind[$s]), free);
        behind[$s] = alpha * lit + (1.0 - alpha) * behind[$s];
        let p = select(vec4<f32>(0.0), alpha * d_alpha, free);
        let gauss = select(vec4<f32>(0.0), at_strip.gauss, free);
        let total = dot(p, vec4<f32>(1.0));
        let along = dot(p, at_strip.dx);
        first += vec4<f32>(along, total * at_strip.dy, dot(gauss, d_alpha),
            dot(weights[$s], vec4<f32>(1.0)));
        second += vec4<f32>(dot(p, at_strip.dx * at_strip.dx), along * at_strip.dy,
            total * at_strip.dy * at_strip.dy, 0.0);
    }
    //end
    partial[at + lane] = first;
    partial[at + LANES + lane] = second;
    //repeat row ROWS
    {
        var sum = vec4<f32>(0.0);
        //repeat s STRIPS
        {
            let g = $s * CHANNELS + 4u * $row;
            sum += vec4<f32>(dot(weights[$s], gradient[g]), dot(weights[$s], gradient[g + 1u]),
                dot(weights[$s], gradient[g + 2u]), dot(weights[$s], gradient[g + 3u]));
        }
        //end
        partial[at + (2u + $row) * LANES + lane] = sum;
    }
    //end
}

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = linear_group(group, groups);
    if tile >= pass_.tiles.x * pass_.tiles.y { return; }
    let corner = vec2<u32>(tile % pass_.tiles.x, tile / pass_.tiles.x);
    let range = ranges[tile];
    load_pixels(corner, lane);
    var end = 0u;
    //repeat s STRIPS
    {
        end = max(end, max(max(last[$s].x, last[$s].y), max(last[$s].z, last[$s].w)));
    }
    //end
    ends[lane] = end;
    workgroupBarrier();
    if lane == 0u {
        for (var i = 1u; i < LANES; i++) { end = max(end, ends[i]); }
        last_end = max(end, range.x);
    }
    var stop = workgroupUniformLoad(&last_end);
    for (var i = (stop - range.x) * RECORD + lane; i < (range.y - range.x) * RECORD; i += LANES) {
        records[slot_from_sorted[range.x + i / RECORD] * RECORD + i % RECORD] = vec4<f32>(0.0);
    }
    while stop > range.x {
        let start = max(stop, range.x + BATCH) - BATCH;
        for (var hit = stop; hit > start; hit--) {
            add_hit(hit - 1u, corner, lane, (hit - 1u - start) * RECORD * LANES);
        }
        workgroupBarrier();
        for (var i = lane; i < (stop - start) * RECORD; i += LANES) {
            var sum = vec4<f32>(0.0);
            for (var other = 0u; other < LANES; other++) {
                sum += partial[i * LANES + other];
            }
            records[slot_from_sorted[start + i / RECORD] * RECORD + i % RECORD] = sum;
        }
        workgroupBarrier();
        stop = start;
    }
}
