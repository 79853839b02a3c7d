// One pixel of the coarser level from 2x2 of the finer one: mean intensity of those that have one,
// mean depth of those within DEPTH_AGREEMENT of the nearest.

@group(0) @binding(0) var<uniform> arguments: PyramidArguments; // size: of the coarser level
@group(0) @binding(1) var<storage, read> fine: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read_write> coarse: array<vec2<f32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let pixel = linear_thread(group, groups, lane);
    if pixel >= arguments.size.x * arguments.size.y { return; }
    let row = row_of(pixel, arguments.size.x);
    let first = 2u * (row * arguments.fine_width + pixel - row * arguments.size.x);
    let a = fine[first];
    let b = fine[first + 1u];
    let c = fine[first + arguments.fine_width];
    let d = fine[first + arguments.fine_width + 1u];
    let grey = vec4<f32>(a.x, b.x, c.x, d.x);
    let depth = vec4<f32>(a.y, b.y, c.y, d.y);
    let bright = select(vec4<f32>(0.0), vec4<f32>(1.0), grey >= vec4<f32>(0.0));
    let intensity = select(-1.0, dot(bright, grey) / sum(bright), sum(bright) > 0.0);
    let far = select(vec4<f32>(HUGE), depth, depth > vec4<f32>(0.0));
    let nearest = min(min(far.x, far.y), min(far.z, far.w));
    let limit = vec4<f32>(nearest * (1.0 + DEPTH_AGREEMENT));
    let agrees = select(vec4<f32>(0.0), vec4<f32>(1.0), far <= limit);
    let mean = select(0.0, dot(agrees, depth) / sum(agrees), nearest < HUGE);
    coarse[pixel] = vec2<f32>(intensity, mean);
}

fn sum(v: vec4<f32>) -> f32 {
    return v.x + v.y + v.z + v.w;
}
