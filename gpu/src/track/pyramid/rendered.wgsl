// A rendered view to (intensity, depth). With opacity O = 1 - T over MIN_OPACITY, color and depth
// are those of the Gaussians alone, without the black background: luma(rgb) / O and D / O.
// Elsewhere there is no intensity (-1) and no depth (0).

@group(0) @binding(0) var<uniform> arguments: PyramidArguments;
@group(0) @binding(1) var<storage, read> image: array<vec4<f32>>; // r, g, b, D = sum z alpha T
@group(0) @binding(2) var<storage, read> pixels: array<PixelState>;
@group(0) @binding(3) var<storage, read_write> bases: array<vec2<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let pixel = linear_thread(group, groups, lane);
    if pixel >= arguments.size.x * arguments.size.y { return; }
    let row = image[pixel];
    let opacity = 1.0 - pixels[pixel].transmittance;
    let grey = luma(row.xyz) / opacity;
    let seen = opacity > MIN_OPACITY && is_finite(grey);
    let base = vec2<f32>(max(grey, 0.0), measured(row.w / opacity));
    bases[pixel] = select(vec2<f32>(-1.0, 0.0), base, seen);
}
