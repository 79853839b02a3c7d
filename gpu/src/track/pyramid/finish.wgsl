// What alignment reads of a pixel: (intensity, depth, dI/du, dI/dv) and the unit normal. Slopes are
// central differences, one-sided at a border or beside a pixel without intensity. n =
// normalise(P_down-up x P_right-left) points to the camera, P = z ((u - cx)/fx, (v - cy)/fy, 1); 0
// at the border, where a neighbour has no depth or differs by more than DEPTH_AGREEMENT, and at an
// edge: where the two neighbours' mean is not the pixel's depth (a slanted surface does not bend, a
// step does).

@group(0) @binding(0) var<uniform> arguments: PyramidArguments;
@group(0) @binding(1) var<storage, read> bases: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read_write> colors: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> surface: array<vec2<u32>>;

@compute @workgroup_size(GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>,
        @builtin(local_invocation_index) lane: u32) {
    let pixel = linear_thread(group, groups, lane);
    let width = arguments.size.x;
    if pixel >= width * arguments.size.y { return; }
    let v = row_of(pixel, width);
    let u = pixel - v * width;
    let inner = u > 0u && v > 0u && u + 1u < width && v + 1u < arguments.size.y;
    let here = bases[pixel];
    let left = bases[pixel - select(0u, 1u, u > 0u)];
    let right = bases[pixel + select(0u, 1u, u + 1u < width)];
    let up = bases[pixel - select(0u, width, v > 0u)];
    let down = bases[pixel + select(0u, width, v + 1u < arguments.size.y)];
    let slope_u = slope(left.x, here.x, right.x, u > 0u, u + 1u < width);
    let slope_v = slope(up.x, here.x, down.x, v > 0u, v + 1u < arguments.size.y);
    colors[pixel] = pack_color(here.x, vec2<f32>(slope_u, slope_v));

    let dx = 1.0 / arguments.focal.x;
    let dy = 1.0 / arguments.focal.y;
    let x = (f32(u) - arguments.centre.x) * dx;
    let y = (f32(v) - arguments.centre.y) * dy;
    let along = right.y * vec3<f32>(x + dx, y, 1.0) - left.y * vec3<f32>(x - dx, y, 1.0);
    let across = down.y * vec3<f32>(x, y + dy, 1.0) - up.y * vec3<f32>(x, y - dy, 1.0);
    let facing = cross(across, along);
    let near = abs(vec4<f32>(left.y, right.y, up.y, down.y) - vec4<f32>(here.y))
        <= vec4<f32>(DEPTH_AGREEMENT * here.y);
    let squared = dot(facing, facing);
    // Differences of neighbours first: they are exact.
    let bend = abs(vec2<f32>((left.y - here.y) + (right.y - here.y), (up.y - here.y) + (down.y - here.y)));
    let flat = all(bend <= vec2<f32>(DEPTH_BEND * here.y));
    let valid = inner && here.y > 0.0 && all(near) && flat && squared > 0.0;
    let direction = pack_normal(facing);
    surface[pixel] = vec2<u32>(bitcast<u32>(here.y), select(NO_NORMAL, direction, valid));
}

fn slope(before: f32, here: f32, after: f32, first: bool, second: bool) -> f32 {
    let low = first && before >= 0.0;
    let high = second && after >= 0.0;
    let span = select(0.0, 1.0, low) + select(0.0, 1.0, high);
    let rise = select(here, after, high) - select(here, before, low);
    return select(0.0, rise / span, span > 0.0 && here >= 0.0);
}
