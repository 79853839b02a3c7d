//! Closes thin gaps in depth that lie within one surface.
//!
//! In: a frame with depth. Out: the same frame, with a depth in each gap that is narrow in its row or in its
//! column and has the same surface on both sides. Cameras whose depth is brought to the color camera leave
//! such gaps all over a surface: lines of single pixels in a time-of-flight camera's picture. Without this a
//! gap ends a surface. Each of its sides gets Gaussians of its own, as small as they may be, the gap itself
//! gets backdrop, and a point in it counts as never seen.
//!
//! Gaps between two surfaces and wide ones stay: nothing is known of them.

use super::downsampled_frame::DownsampledFrame;
use std::borrow::Cow;

/// Pixels of the widest gap that is closed.
const WIDEST: usize = 8;
/// Both sides of a gap belong to one surface if their depths differ by at most this share for each pixel
/// from one to the other: a surface that is seen at a slant of about 80 degrees.
const SLOPE: f32 = 0.01;
/// They never do if they differ by more than this share.
const SAME_SURFACE: f32 = 0.05;

/// The frame with its gaps closed; the frame itself if it has none.
pub(super) fn closed(frame: &DownsampledFrame) -> Cow<'_, DownsampledFrame> {
    let width = frame.camera.width as usize;
    let measured = &*frame.depth_metres;
    let is_measured = |depth: &f32| *depth > 0.0;
    if measured.iter().all(is_measured) {
        return Cow::Borrowed(frame);
    }
    let mut gaps = Gaps { depths: measured.to_vec(), widths: vec![0; measured.len()] };
    // The last measured pixel of each column, and of the row.
    let mut above = vec![None; width];
    for (row, depths) in measured.chunks_exact(width).enumerate() {
        let mut left = None;
        for column in (0..width).filter(|column| is_measured(&depths[*column])) {
            let at = row * width + column;
            for (before, stride) in [(left.replace(at), 1), (above[column].replace(at), width)] {
                if let Some(before) = before.filter(|before| at - before > stride) {
                    gaps.close(before, at, stride);
                }
            }
        }
    }
    if gaps.widths.iter().all(|width| *width == 0) {
        return Cow::Borrowed(frame);
    }
    Cow::Owned(DownsampledFrame { depth_metres: gaps.depths.into(), ..frame.clone() })
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
    use lexsplat_gpu::Camera;
    use nalgebra::{Isometry3, Point3};

    const WIDTH: usize = 32;
    const HEIGHT: usize = 16;

    fn frame(depth: impl Fn(usize, usize) -> f32) -> DownsampledFrame {
        let camera = Camera {
            width: WIDTH as u32,
            height: HEIGHT as u32,
            fx: 30.0,
            fy: 30.0,
            cx: 15.5,
            cy: 7.5,
            camera_from_world: Isometry3::identity(),
        };
        let depths = (0..WIDTH * HEIGHT).map(|at| depth(at % WIDTH, at / WIDTH));
        DownsampledFrame {
            camera,
            rgb: vec![128; WIDTH * HEIGHT * 3].into(),
            depth_metres: depths.collect(),
        }
    }

    /// z = 2 + x/10.
    fn slanted(column: usize) -> f32 {
        2.0 / (1.0 - 0.1 * (column as f32 - 15.5) / 30.0)
    }

    #[test]
    fn gaps_within_a_surface_get_its_depth() {
        let is_gap = |x: usize, y: usize| (x + 2 * y).is_multiple_of(5) || (10..16).contains(&x);
        let gapped = frame(|x, y| if is_gap(x, y) { 0.0 } else { slanted(x) });
        let closed = closed(&gapped);
        for (at, found) in closed.depth_metres.iter().enumerate() {
            let (x, truth) = (at % WIDTH, slanted(at % WIDTH));
            // The outermost pixels may have no surface on one side.
            if (1..WIDTH - 1).contains(&x) && *found > 0.0 {
                assert!((found - truth).abs() < 1e-4, "{found}, not {truth}, in column {x}");
            }
        }
        let holes = |frame: &DownsampledFrame| {
            frame.depth_metres.iter().filter(|depth| **depth == 0.0).count()
        };
        assert!(holes(&gapped) > 150, "negative control");
        assert!(holes(&closed) < 10, "{} are left", holes(&closed));
        let middle = Point3::new((12.0 - 15.5) / 30.0 * slanted(12), 0.0, slanted(12));
        assert!(closed.shows(&middle) && !gapped.shows(&middle));
    }

    #[test]
    fn gaps_between_surfaces_and_wide_ones_stay() {
        let step = frame(|x, _| match x {
            0..10 => 2.0,
            10..13 => 0.0,
            _ => 2.2,
        });
        assert!(matches!(closed(&step), Cow::Borrowed(_)), "two surfaces");
        let wide =
            |count: usize| frame(move |x, _| if (8..8 + count).contains(&x) { 0.0 } else { 2.0 });
        assert!(matches!(closed(&wide(WIDEST + 1)), Cow::Borrowed(_)), "too wide");
        let narrow = wide(WIDEST);
        assert!(closed(&narrow).depth_metres.iter().all(|depth| *depth == 2.0), "negative control");
        let whole = frame(|_, _| 2.0);
        assert!(matches!(closed(&whole), Cow::Borrowed(_)), "nothing to close");
    }
}
