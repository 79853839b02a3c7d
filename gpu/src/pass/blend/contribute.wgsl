// The contribution of each hit to a finished image. The record of a hit is one row: (sum of its
// blending weights, number of pixels with more than half of the light left behind the hit, 0, 0).

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> ranges: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> slot_from_sorted: array<u32>;
@group(0) @binding(3) var<storage, read> gaussian_from_sorted: array<u32>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
@group(0) @binding(5) var<storage, read> pixels: array<PixelState>;
@group(0) @binding(6) var<storage, read_write> records: array<vec4<f32>>;

var<private> transmittance: array<vec4<f32>, STRIPS>;
var<private> last: array<vec4<u32>, STRIPS>;

fn add_hit(hit: u32, other: u32, corner: vec2<u32>, lane: u32) {
    let place = shared_row(0u, other);
    let form = shared_row(1u, other);
    var sum = vec4<f32>(0.0);
    //repeat s STRIPS
    {
        let origin = vec2<f32>(strip_origin(corner, lane, $s));
        let found = footprint(place, form, origin).alpha;
        let alpha = select(vec4<f32>(0.0), found, vec4<u32>(hit) < last[$s]);
        let weight = min(alpha, vec4<f32>(MAX_ALPHA)) * transmittance[$s];
        transmittance[$s] -= weight;
        let seen = (weight > vec4<f32>(0.0)) & (transmittance[$s] > vec4<f32>(0.5));
        sum += vec4<f32>(dot(weight, vec4<f32>(1.0)),
            dot(select(vec4<f32>(0.0), vec4<f32>(1.0), seen), vec4<f32>(1.0)), 0.0, 0.0);
    }
    //end
    accumulate(other, 0u, sum, lane);
}

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = pass_.band.x * pass_.tiles.x + linear_group(group, groups);
    if tile >= pass_.band.y * pass_.tiles.x { return; }
    let corner = vec2<u32>(tile % pass_.tiles.x, tile / pass_.tiles.x);
    let range = ranges[tile];
    //repeat s STRIPS
    {
        let origin = strip_origin(corner, lane, $s);
        let drawn = inside(origin, pass_.size);
        transmittance[$s] = vec4<f32>(1.0);
        for (var x = 0u; x < 4u; x++) {
            if drawn[x] { last[$s][x] = pixels[origin.y * pass_.size.x + origin.x + x].last; }
        }
    }
    //end
    for (var start = range.x; start < range.y; start += BATCH) {
        publish_hits(start, range.y, lane);
        sync_lanes();
        //repeat j BATCH
        add_hit(start + $j, $j, corner, lane);
        //end
        sync_lanes();
        if lane < BATCH && start + lane < range.y {
            records[slot_from_sorted[start + lane]] = record_row(0u, lane);
        }
    }
}
