//! Which depth belongs to which color, by time.

/// The least that color and depth may be apart, nanoseconds.
const LEAST_WINDOW_NANOS: u64 = 5_000_000;

/// How far color and depth may be apart in time, nanoseconds: half the usual time between two pictures of the
/// faster of both, and a little more.
pub fn window(colors: &[u64], depths: &[u64]) -> u64 {
    let usual = |times: &[u64]| {
        let mut apart: Vec<u64> = times.windows(2).map(|two| two[0].abs_diff(two[1])).collect();
        apart.sort_unstable();
        apart.get(apart.len() / 2).copied()
    };
    let shortest = usual(colors).into_iter().chain(usual(depths)).min().unwrap_or_default();
    (shortest / 2 + shortest / 20).max(LEAST_WINDOW_NANOS)
}

/// Pairs of places in two lists of times, at most `within` nanoseconds apart. Each is used once, the
/// nearest are served first. Sorted by the first place.
pub fn pair(colors: &[u64], depths: &[u64], within: u64) -> Vec<(usize, usize)> {
    let mut order: Vec<usize> = (0..depths.len()).collect();
    order.sort_by_key(|at| depths[*at]);
    let mut close = Vec::new();
    for (i, color) in colors.iter().enumerate() {
        let from = order.partition_point(|at| depths[*at] < color.saturating_sub(within));
        let near = order[from..].iter().map(|at| (color.abs_diff(depths[*at]), i, *at));
        close.extend(near.take_while(|(apart, ..)| *apart <= within));
    }
    close.sort_unstable();
    let (mut used_colors, mut used_depths) = (vec![false; colors.len()], vec![false; depths.len()]);
    let mut pairs = Vec::new();
    for (_, color, depth) in close {
        if !used_colors[color] && !used_depths[depth] {
            (used_colors[color], used_depths[depth]) = (true, true);
            pairs.push((color, depth));
        }
    }
    pairs.sort_unstable();
    pairs
}
