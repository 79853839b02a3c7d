// The largest blending weight that each Gaussian had in the last forward pass, as float bits: the
// order of positive floats is the order of their bits, so an integer maximum will do.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> ranges: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> gaussian_from_sorted: array<u32>;
@group(0) @binding(3) var<storage, read> splats: array<Splat>;
@group(0) @binding(4) var<storage, read> pixels: array<PixelState>;
@group(0) @binding(5) var<storage, read_write> weights: array<atomic<u32>>;

@compute @workgroup_size(LANES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let tile = linear_group(group, groups);
    if tile >= pass_.tiles.x * pass_.tiles.y { return; }
    let corner = vec2<u32>(tile % pass_.tiles.x, tile / pass_.tiles.x);
    let range = ranges[tile];
    for (var s = 0u; s < STRIPS; s++) {
        let origin = strip_origin(corner, lane, s);
        let drawn = inside(origin, pass_.size);
        var last = vec4<u32>(0u);
        for (var x = 0u; x < 4u; x++) {
            if drawn[x] { last[x] = pixels[origin.y * pass_.size.x + origin.x + x].last; }
        }
        let end = max(max(last.x, last.y), max(last.z, last.w));
        var transmittance = vec4<f32>(1.0);
        for (var hit = range.x; hit < end; hit++) {
            let gaussian = gaussian_from_sorted[hit];
            let behind = vec4<u32>(hit) < last;
            let alpha = select(vec4<f32>(0.0), footprint(splats[gaussian], origin).alpha, behind);
            let weight = alpha * transmittance;
            transmittance -= weight;
            let most = max(max(weight.x, weight.y), max(weight.z, weight.w));
            if most > 0.0 { atomicMax(&weights[gaussian], bitcast<u32>(most)); }
        }
    }
}
