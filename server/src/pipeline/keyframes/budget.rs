//! Which keyframe is forgotten when keyframes take more memory than `mapper.max_keyframe_mib`: the one whose
//! surface the others show best.
//!
//! Its Gaussians stay in the map, and frames that were tracked relative to it keep their poses. The map is
//! no longer optimised for it, and a lost camera is no longer found by it.

use super::super::downsampled_frame::DownsampledFrame;
use super::surface_sample::SurfaceSample;
use std::cmp::Reverse;

/// Points of a keyframe that are looked up in the others.
const SAMPLES: f64 = 100.0;

/// Index of the image whose surface the other images show best. Of equal images it is the newest, because
/// poses are anchored to the oldest. The newest `window` images are considered only if there are no others,
/// and the newest image never.
pub(super) fn most_redundant(images: &[&DownsampledFrame], window: usize) -> Option<usize> {
    let count = images.len();
    let candidates = if count > window { count - window } else { count.saturating_sub(1) };
    let novelty = |at: usize| {
        let sample = SurfaceSample::new(&images[at].camera, &images[at].depth_metres, SAMPLES);
        let others = images.iter().enumerate().filter(|(other, _)| *other != at);
        sample.novelty(others.map(|(_, image)| *image))
    };
    (0..candidates)
        .map(|at| (novelty(at), at))
        .min_by(|(a, i), (b, j)| a.total_cmp(b).then(Reverse(i).cmp(&Reverse(j))))
        .map(|(_, at)| at)
}

#[cfg(test)]
mod tests {
    use super::super::surface_sample::tests::wall;
    use super::*;

    fn forgotten(places: &[f32], window: usize) -> Option<usize> {
        let images: Vec<DownsampledFrame> = places.iter().map(|metres| wall(*metres)).collect();
        most_redundant(&images.iter().collect::<Vec<_>>(), window)
    }

    #[test]
    fn the_keyframe_that_others_show_is_forgotten_first() {
        // Each shows two metres of the wall.
        assert_eq!(forgotten(&[0.0, 1.0, 2.0, 9.0], 1), Some(1), "between its neighbours");
        assert_eq!(forgotten(&[0.0, 3.0, 4.0, 5.0], 1), Some(2));
        assert_eq!(
            forgotten(&[0.0, 0.0, 9.0, 20.0], 1),
            Some(1),
            "of two that are alike the newer"
        );
        assert_eq!(forgotten(&[0.0, 9.0, 20.0, 9.5], 1), Some(1), "the newest counts as a witness");
    }

    #[test]
    fn the_window_is_forgotten_last() {
        assert_eq!(forgotten(&[0.0, 9.0, 9.0, 9.0], 3), Some(0), "though nobody else shows it");
        assert_eq!(forgotten(&[0.0, 9.0, 9.0], 3), Some(1), "nothing but the window");
        assert_eq!(forgotten(&[0.0], 3), None);
        assert_eq!(forgotten(&[], 3), None);
    }
}
