// What a training view says of the Gaussians that its step moved, added to their statistics (rows as
// in gaussians/statistics.rs). dL/dmean2 = -K (sx, sy) with the conic K and the record sums
// s = sum dL/dpower d; in units of half the picture's size, as 3D Gaussian Splatting thresholds it.

@group(0) @binding(0) var<uniform> pass_: PassArguments;
@group(0) @binding(1) var<storage, read> gaussian_from_visible: array<u32>;
@group(0) @binding(2) var<storage, read> corrections: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> sums: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
@group(0) @binding(5) var<storage, read_write> statistics: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let index = linear_thread(group, groups, lane);
    if index >= pass_.count || !(corrections[index].x > 0.0) { return; }
    let gaussian = gaussian_from_visible[index];
    let splat = splats[gaussian];
    let first = sums[SUMS * index];
    let conic = vec3<f32>(2.0, 1.0, 2.0) * conic_of_splat(splat) / BITS_PER_NAT;
    let d_mean = vec2<f32>(dot(conic.xy, first.xy), dot(conic.yz, first.xy));
    let norm = length(d_mean * 0.5 * vec2<f32>(pass_.size));
    let row = 2u * gaussian;
    statistics[row] = vec4<f32>(
        statistics[row].x + select(0.0, norm, norm < MAX_GRADIENT),
        statistics[row].y + 1.0,
        max(statistics[row].z, max(splat.extent.x, splat.extent.y)),
        0.0,
    );
    let touched = sums[SUMS * index + 1u].w;
    statistics[row + 1u] += vec4<f32>(first.w, touched, 0.0, 0.0);
}
