//! Reference, not for production: bit by bit, and the standard library's stable sort. In `f32`,
//! because the order must agree exactly.

use lexsplat_gpu::shader::layout::{HUGE, MORTON_CELLS, MORTON_LAST};

/// The key of one mean in a box.
pub fn code(mean: [f32; 3], low: [f32; 3], high: [f32; 3]) -> u32 {
    if !finite(mean) {
        return MORTON_LAST;
    }
    let arguments = lexsplat_gpu::map::morton::arguments(pad(low), pad(high), 1);
    let mut key = 0;
    for axis in 0..3 {
        let cell = ((mean[axis] - low[axis]) * arguments.scale[axis]) as u32;
        let cell = cell.min(MORTON_CELLS - 1);
        for bit in 0..10 {
            key |= (cell >> bit & 1) << (3 * bit + axis as u32);
        }
    }
    key
}

/// The Gaussians in Morton order; equal keys keep their order.
pub fn order(means: &[[f32; 3]]) -> Vec<u32> {
    let (mut low, mut high) = ([HUGE; 3], [-HUGE; 3]);
    for mean in means.iter().filter(|mean| finite(**mean)) {
        for axis in 0..3 {
            low[axis] = low[axis].min(mean[axis]);
            high[axis] = high[axis].max(mean[axis]);
        }
    }
    let mut order: Vec<u32> = (0..means.len() as u32).collect();
    order.sort_by_key(|i| code(means[*i as usize], low, high));
    order
}

fn finite(mean: [f32; 3]) -> bool {
    mean.iter().all(|v| v.abs() < HUGE)
}

fn pad(p: [f32; 3]) -> [f32; 4] {
    [p[0], p[1], p[2], 0.0]
}
