//! Closes thin gaps in depth that lie within one surface.
//!
//! In: depth. Out: the same, with a depth in each gap that is narrow in its row or in its
//! column and has the same surface on both sides. Cameras whose depth is brought to the color camera leave
//! such gaps all over a surface: lines of single pixels in a time-of-flight camera's picture. Without this a
//! gap ends a surface. Each of its sides gets Gaussians of its own, as small as they may be, the gap itself
//! gets backdrop, and a point in it counts as never seen.
//!
//! Gaps between two surfaces and wide ones stay: nothing is known of them.

/// Pixels of the widest gap that is closed.
const WIDEST: usize = 8;
/// Both sides of a gap belong to one surface if their depths differ by at most this share for each pixel
/// from one to the other: a surface that is seen at a slant of about 80 degrees.
const SLOPE: f32 = 0.01;
/// They never do if they differ by more than this share.
const SAME_SURFACE: f32 = 0.05;

/// Depth with its gaps closed; `None` if there are none to close. `depth_metres`: rows of `width` pixels, 0
/// where nothing was measured.
pub fn without_gaps(depth_metres: &[f32], width: usize) -> Option<Vec<f32>> {
    if depth_metres.iter().all(|depth| *depth > 0.0) {
        return None;
    }
    let mut gaps = Gaps { depths: depth_metres.to_vec(), widths: vec![0; depth_metres.len()] };
    // The last measured pixel of each column, and of the row, and one behind it.
    let mut above = vec![0; width];
    for row in 0..depth_metres.len() / width {
        let mut left = 0;
        for (column, above) in above.iter_mut().enumerate() {
            let at = row * width + column;
            if depth_metres[at] > 0.0 {
                for (behind, stride) in [(left, 1), (*above, width)] {
                    if behind > 0 && at + 1 - behind > stride {
                        gaps.close(behind - 1, at, stride);
                    }
                }
                (left, *above) = (at + 1, at + 1);
            }
        }
    }
    gaps.widths.iter().any(|width| *width > 0).then_some(gaps.depths)
}

/// The pixels that are closed.
struct Gaps {
    /// `[height * width]`, metres; 0 without a measurement.
    depths: Vec<f32>,
    /// Width of the narrowest gap that a pixel lies in, pixels; 0 if that is not closed.
    widths: Vec<u8>,
}

impl Gaps {
    /// Closes what lies between two measured pixels of a row or column, which are `stride` apart. Inverse
    /// depth is linear across the picture of a plane.
    fn close(&mut self, before: usize, after: usize, stride: usize) {
        let width = (after - before) / stride - 1;
        let (from, to) = (self.depths[before], self.depths[after]);
        let steps = (width + 1) as f32;
        let limit = f32::min(SLOPE * steps, SAME_SURFACE) * f32::min(from, to);
        if width > WIDEST || (from - to).abs() > limit {
            return;
        }
        for step in 1..=width {
            let share = step as f32 / steps;
            let at = before + step * stride;
            let narrowest = usize::from(self.widths[at]);
            if narrowest == 0 || width < narrowest {
                self.widths[at] = width as u8;
                self.depths[at] = 1.0 / ((1.0 - share) / from + share / to);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 32;
    const HEIGHT: usize = 16;

    fn picture(depth: impl Fn(usize, usize) -> f32) -> Vec<f32> {
        (0..WIDTH * HEIGHT).map(|at| depth(at % WIDTH, at / WIDTH)).collect()
    }

    /// z = 2 + x/10, seen with a focal length of 30 pixels.
    fn slanted(column: usize) -> f32 {
        2.0 / (1.0 - 0.1 * (column as f32 - 15.5) / 30.0)
    }

    #[test]
    fn gaps_within_a_surface_get_its_depth() {
        let is_gap = |x: usize, y: usize| (x + 2 * y).is_multiple_of(5) || (10..16).contains(&x);
        let gapped = picture(|x, y| if is_gap(x, y) { 0.0 } else { slanted(x) });
        let closed = without_gaps(&gapped, WIDTH).expect("it has gaps");
        for (at, found) in closed.iter().enumerate() {
            let (x, truth) = (at % WIDTH, slanted(at % WIDTH));
            // The outermost pixels may have no surface on one side.
            if (1..WIDTH - 1).contains(&x) && *found > 0.0 {
                assert!((found - truth).abs() < 1e-4, "{found}, not {truth}, in column {x}");
            }
        }
        let holes = |depths: &[f32]| depths.iter().filter(|depth| **depth == 0.0).count();
        assert!(holes(&gapped) > 150, "negative control");
        assert!(holes(&closed) < 10, "{} are left", holes(&closed));
    }

    #[test]
    fn gaps_between_surfaces_and_wide_ones_stay() {
        let step = picture(|x, _| match x {
            0..10 => 2.0,
            10..13 => 0.0,
            _ => 2.2,
        });
        assert!(without_gaps(&step, WIDTH).is_none(), "two surfaces");
        let wide =
            |count: usize| picture(move |x, _| if (8..8 + count).contains(&x) { 0.0 } else { 2.0 });
        assert!(without_gaps(&wide(WIDEST + 1), WIDTH).is_none(), "too wide");
        let narrow = without_gaps(&wide(WIDEST), WIDTH).expect("negative control");
        assert!(narrow.iter().all(|depth| *depth == 2.0), "negative control");
        assert!(without_gaps(&picture(|_, _| 2.0), WIDTH).is_none(), "nothing to close");
        let rows = picture(|_, y| if (5..8).contains(&y) { 0.0 } else { 2.0 });
        assert!(without_gaps(&rows, WIDTH).is_some_and(|depths| depths.iter().all(|z| *z == 2.0)));
    }
}
