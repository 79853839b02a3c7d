// Front to back over a tile's list: w = alpha T, image += w feature, T *= 1 - alpha (Kerbl et al.
// 2023, appendix C).
// A Gaussian is skipped where alpha < MIN_ALPHA; a pixel is full before T would fall below
// MIN_TRANSMITTANCE. The pixels of a tile that is left out have no hits, and keep their image. With DEPTH
// the fourth channel is z. One dispatch blends CHUNK of ROWS rows.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> ranges: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> gaussian_from_sorted: array<u32>;
@group(0) @binding(3) var<storage, read> splats: array<Splat>;
@group(0) @binding(4) var<storage, read> features: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> left_out: array<u32>;
@group(0) @binding(6) var<storage, read_write> image: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> pixels: array<PixelState>;

var<private> open: array<vec4<bool>, STRIPS>;
var<private> transmittance: array<vec4<f32>, STRIPS>;
var<private> last: array<vec4<u32>, STRIPS>;
var<private> sums: array<vec4<f32>, 4 * CHUNK * STRIPS>; // channel by channel, four pixels each

/// Blends hit `hit` of the lists, which lane `other` published, into this lane's pixels.
fn blend_hit(hit: u32, other: u32, corner: vec2<u32>, lane: u32) {
    let place = shared_row(0u, other);
    let form = shared_row(1u, other);
    //repeat s STRIPS
    {
        let origin = vec2<f32>(strip_origin(corner, lane, $s));
        let alpha = min(footprint(place, form, origin).alpha, vec4<f32>(MAX_ALPHA));
        let through = transmittance[$s] * (1.0 - alpha);
        open[$s] = open[$s] & (through >= vec4<f32>(MIN_TRANSMITTANCE));
        let weight = select(vec4<f32>(0.0), alpha * transmittance[$s], open[$s]);
        transmittance[$s] = select(transmittance[$s], through, open[$s]);
        last[$s] = select(last[$s], vec4<u32>(hit + 1u), weight > vec4<f32>(0.0));
        //repeat row CHUNK
        {
            let feature = shared_row(2u + $row, other);
            let at = ($s * CHUNK + $row) * 4u;
            sums[at] += weight * feature.x;
            sums[at + 1u] += weight * feature.y;
            sums[at + 2u] += weight * feature.z;
            sums[at + 3u] += weight * feature.w;
        }
        //end
    }
    //end
}

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = pass_.band.x * pass_.tiles.x + linear_group(group, groups);
    if tile >= pass_.band.y * pass_.tiles.x { return; }
    let corner = vec2<u32>(tile % pass_.tiles.x, tile / pass_.tiles.x);
    var range = ranges[tile];
    let is_left_out = left_out[tile] != 0u;
    if is_left_out { range.y = range.x; }
    //repeat s STRIPS
    {
        open[$s] = inside(strip_origin(corner, lane, $s), pass_.size);
        transmittance[$s] = vec4<f32>(1.0);
    }
    //end
    for (var start = range.x; start < range.y; start += BATCH) {
        publish_hits(start, range.y, lane);
        sync_lanes();
        //repeat j BATCH
        blend_hit(start + $j, $j, corner, lane);
        //end
        var busy = false;
        //repeat s STRIPS
        busy = busy || any(open[$s]);
        //end
        if largest(u32(busy), lane) == 0u { break; }
    }
    //repeat s STRIPS
    {
        let origin = strip_origin(corner, lane, $s);
        let drawn = inside(origin, pass_.size);
        for (var x = 0u; x < 4u; x++) {
            if !drawn[x] { continue; }
            let pixel = origin.y * pass_.size.x + origin.x + x;
            pixels[pixel] = PixelState(transmittance[$s][x], last[$s][x]);
            //repeat row CHUNK
            {
                let at = ($s * CHUNK + $row) * 4u;
                let row = pass_.chunk * CHUNK + $row;
                if row < ROWS && !is_left_out {
                    image[pixel * ROWS + row] = vec4<f32>(
                        sums[at][x], sums[at + 1u][x], sums[at + 2u][x], sums[at + 3u][x]);
                }
            }
            //end
        }
    }
    //end
}
