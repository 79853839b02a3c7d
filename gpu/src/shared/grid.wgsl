/// Index of a workgroup in a grid that `kernel.rs` split over two axes.
fn linear_group(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return group.x + group.y * groups.x;
}

/// Index of a thread of the kernels with one thread per element.
fn linear_thread(group: vec3<u32>, groups: vec3<u32>, lane: u32) -> u32 {
    return linear_group(group, groups) * GROUP + lane;
}

/// True for numbers that arithmetic can go on with; NaN and infinity fail every comparison.
fn is_finite(x: f32) -> bool {
    return abs(x) < HUGE;
}
