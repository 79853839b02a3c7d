/// Index of a workgroup in a grid that recorder.rs split over two axes.
fn linear_group(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return group.x + group.y * groups.x;
}

/// Index of a thread of the kernels with one thread per element.
fn linear_thread(group: vec3<u32>, groups: vec3<u32>, lane: u32) -> u32 {
    return linear_group(group, groups) * GROUP + lane;
}

/// True for numbers below HUGE; false for NaN and infinity.
fn is_finite(x: f32) -> bool {
    return abs(x) < HUGE;
}

/// Workgroups of GROUP threads for so many threads, over two axes.
fn groups_for(threads: u32) -> array<u32, 3> {
    let groups = (threads + GROUP - 1u) / GROUP;
    let rows = (groups + GROUPS_PER_AXIS - 1u) / GROUPS_PER_AXIS;
    return array<u32, 3>(min(groups, GROUPS_PER_AXIS), max(rows, 1u), 1u);
}
