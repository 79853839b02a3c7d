// A pixel of a level, packed: memory is what alignment waits for.
// Color: intensity as it is, slopes dI/du and dI/dv in 16 bits each, which is 1.5e-5 or better.
// Surface: depth as it is, the normal on an octahedron in 16 bits an axis, 5e-5 or better; NO_NORMAL for
// none.

fn pack_color(intensity: f32, slopes: vec2<f32>) -> vec2<u32> {
    return vec2<u32>(bitcast<u32>(intensity), pack2x16snorm(slopes));
}

/// Intensity and slopes.
fn color(packed: vec2<u32>) -> vec3<f32> {
    return vec3<f32>(bitcast<f32>(packed.x), unpack2x16snorm(packed.y));
}

/// A normal of any length on the octahedron |x| + |y| + |z| = 1, whose lower half is folded over its edges.
fn pack_normal(normal: vec3<f32>) -> u32 {
    let flat = normal.xy / (abs(normal.x) + abs(normal.y) + abs(normal.z));
    return pack2x16snorm(select(fold(flat), flat, normal.z >= 0.0));
}

/// The normal and 1, or 0 if there is none.
fn normal(packed: u32) -> vec4<f32> {
    let flat = unpack2x16snorm(packed);
    let height = 1.0 - abs(flat.x) - abs(flat.y);
    let wide = vec3<f32>(select(fold(flat), flat, height >= 0.0), height);
    return select(vec4<f32>(wide * inverseSqrt(dot(wide, wide)), 1.0), vec4<f32>(0.0), packed == NO_NORMAL);
}

fn fold(flat: vec2<f32>) -> vec2<f32> {
    let side = select(vec2<f32>(-1.0), vec2<f32>(1.0), flat >= vec2<f32>(0.0));
    return (1.0 - abs(flat.yx)) * side;
}
