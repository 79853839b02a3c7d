// Front to back over a tile's list: w = alpha T, image += w feature, T *= 1 - alpha (Kerbl et al.
// 2023, appendix C).
// A Gaussian is skipped where alpha < MIN_ALPHA; a pixel is full before T would fall below
// MIN_TRANSMITTANCE. With DEPTH the fourth channel is z.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> ranges: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> gaussian_from_sorted: array<u32>;
@group(0) @binding(3) var<storage, read> splats: array<Splat>;
@group(0) @binding(4) var<storage, read> features: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> image: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> pixels: array<PixelState>;

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = linear_group(group, groups);
    if tile >= pass_.tiles.x * pass_.tiles.y { return; }
    let corner = vec2<u32>(tile % pass_.tiles.x, tile / pass_.tiles.x);
    let range = ranges[tile];
    var open: array<vec4<bool>, STRIPS>;
    var transmittance: array<vec4<f32>, STRIPS>;
    var last: array<vec4<u32>, STRIPS>;
    var sums: array<vec4<f32>, STRIPS * CHANNELS>; // channel by channel, four pixels each
    //repeat s STRIPS
    {
        open[$s] = inside(strip_origin(corner, lane, $s), pass_.size);
        transmittance[$s] = vec4<f32>(1.0);
    }
    //end
    for (var hit = range.x; hit < range.y; hit++) {
        let gaussian = gaussian_from_sorted[hit];
        let splat = splats[gaussian];
        var busy = false;
        //repeat s STRIPS
        {
            let alpha = footprint(splat, strip_origin(corner, lane, $s)).alpha;
            let through = transmittance[$s] * (1.0 - alpha);
            open[$s] = open[$s] & (through >= vec4<f32>(MIN_TRANSMITTANCE));
            let weight = select(vec4<f32>(0.0), alpha * transmittance[$s], open[$s]);
            transmittance[$s] = select(transmittance[$s], through, open[$s]);
            last[$s] = select(last[$s], vec4<u32>(hit + 1u), weight > vec4<f32>(0.0));
            //repeat row ROWS
            {
                let feature = feature_of(gaussian, $row, splat.depth);
                let at = $s * CHANNELS + 4u * $row;
                sums[at] += weight * feature.x;
                sums[at + 1u] += weight * feature.y;
                sums[at + 2u] += weight * feature.z;
                sums[at + 3u] += weight * feature.w;
            }
            //end
            busy = busy || any(open[$s]);
        }
        //end
        if !busy { break; }
    }
    //repeat s STRIPS
    {
        let origin = strip_origin(corner, lane, $s);
        let drawn = inside(origin, pass_.size);
        for (var x = 0u; x < 4u; x++) {
            if !drawn[x] { continue; }
            let pixel = origin.y * pass_.size.x + origin.x + x;
            pixels[pixel] = PixelState(transmittance[$s][x], last[$s][x]);
            //repeat row ROWS
            {
                let at = $s * CHANNELS + 4u * $row;
                image[pixel * ROWS + $row] =
                    vec4<f32>(sums[at][x], sums[at + 1u][x], sums[at + 2u][x], sums[at + 3u][x]);
            }
            //end
        }
    }
    //end
}
