// The adapter's ceiling: evaluates and blends one Gaussian per pixel and step from a linear list,
// and does nothing else. Same arithmetic and the same loads as the blend, no list, no early end.

@group(0) @binding(0) var<uniform> arguments: ArrayArguments; // count: hits per tile; detail: tiles
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> features: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> image: array<vec4<f32>>;

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = linear_group(group, groups);
    if tile >= arguments.detail { return; }
    var transmittance: array<vec4<f32>, STRIPS>;
    var sums: array<vec4<f32>, 4 * STRIPS>;
    //repeat s STRIPS
    transmittance[$s] = vec4<f32>(1.0);
    //end
    for (var start = 0u; start < arguments.count; start += BATCH) {
        let splat = splats[start + lane % BATCH];
        publish(0u, splat.place, lane);
        publish(1u, splat.form, lane);
        publish(2u, features[start + lane % BATCH], lane);
        sync_lanes();
        //repeat j BATCH
        {
            let place = shared_row(0u, $j);
            let form = shared_row(1u, $j);
            let feature = shared_row(2u, $j);
            //repeat s STRIPS
            {
                let origin = vec2<f32>(strip_origin(vec2<u32>(0u), lane, $s));
                let alpha = min(footprint(place, form, origin).alpha, vec4<f32>(MAX_ALPHA));
                let weight = alpha * transmittance[$s];
                transmittance[$s] -= weight;
                let at = 4u * $s;
                sums[at] += weight * feature.x;
                sums[at + 1u] += weight * feature.y;
                sums[at + 2u] += weight * feature.z;
                sums[at + 3u] += weight * feature.w;
            }
            //end
        }
        //end
        sync_lanes();
    }
    var sum = vec4<f32>(0.0);
    //repeat s STRIPS
    for (var x = 0u; x < 4u; x++) {
        let at = 4u * $s;
        sum += vec4<f32>(sums[at][x], sums[at + 1u][x], sums[at + 2u][x], sums[at + 3u][x]);
    }
    //end
    image[tile * LANES + lane] = sum;
}
