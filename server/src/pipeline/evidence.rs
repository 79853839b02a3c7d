//! What the keyframes say of each Gaussian's language: how many show it, and how far their codes spread around
//! the code that the map has.
//!
//! The map keeps one code for each Gaussian, a compromise between the codes of all keyframes that show it
//! (paper §4.3). Where these differ, the encoder was unsure, and so is an answer from that code. The evidence is
//! computed from the keyframes of a snapshot when a reader first asks for it. It needs no state, so poses that
//! are corrected and Gaussians that are pruned are no special cases.

use super::compressor::{GENERIC_SIZE, OnlineStage};
use super::downsampled_frame::DownsampledFrame;
use super::keyframes::Codes;
use lexsplat_gpu::{Camera, HostGaussians};
use nalgebra::Point3;
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// The spread in clean, rendered rooms, in which bundles are calibrated; and of Gaussians without evidence.
pub(super) const REFERENCE_SPREAD: f32 = 0.2;
/// Views that the map's mean variance, at least the reference, counts as: a Gaussian that was seen once is not
/// sure because its only view agrees with it.
const PRIOR_VIEWS: f32 = 5.0;
/// Pairs of a Gaussian and a view that are looked at: a second or two. Of large maps with many keyframes,
/// views in equal steps are used.
const MOST_PAIRS: usize = 20_000_000;
/// Views that are used in any case.
const LEAST_VIEWS: usize = 16;
/// The least variance: that of codes in half precision and of the interpolation between pixels.
const LEAST_VARIANCE: f32 = 0.005;

/// A keyframe's 32-D codes, and what tells which Gaussians they belong to. Cloning shares the data.
#[derive(Clone)]
pub(super) struct LanguageView {
    /// Color and depth of the keyframe.
    pub image: DownsampledFrame,
    /// The keyframe's camera at the resolution of the codes.
    pub camera: Camera,
    /// `[height * width * 32]`, row-major.
    pub codes: Arc<Codes>,
}

/// What the keyframes say of one Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sightings {
    /// Number of keyframes with language that show it.
    pub views: u32,
    /// Standard deviation of their unit codes from the map's, as a share of the length: sqrt(1 - mean cosine),
    /// drawn towards the map's mean where views are few. Greater than 0.
    pub spread: f32,
}

/// The evidence of one snapshot's Gaussians.
#[derive(Default)]
pub struct Evidence {
    views: Vec<LanguageView>,
    sightings: OnceLock<Vec<Sightings>>,
}

impl Evidence {
    pub(super) fn new(views: Vec<LanguageView>) -> Self {
        Self { views, sightings: OnceLock::new() }
    }

    /// What the keyframes say of each of the snapshot's Gaussians; computed when it is first asked for.
    /// `online` decodes their codes.
    pub(super) fn sightings(
        &self,
        gaussians: &HostGaussians,
        online: &dyn OnlineStage,
    ) -> &[Sightings] {
        self.sightings.get_or_init(|| {
            let codes = online.decode(&gaussians.language.features);
            let rows = gaussians.means.par_iter().zip(codes.par_chunks_exact(GENERIC_SIZE));
            let most = (MOST_PAIRS / gaussians.len().max(1)).max(LEAST_VIEWS);
            let views: Vec<&LanguageView> =
                self.views.iter().step_by(self.views.len().div_ceil(most).max(1)).collect();
            let seen = rows.map(|(mean, code)| seen_by(&views, &(*mean).into(), code));
            sightings(&seen.collect::<Vec<_>>())
        })
    }
}

/// Number of views that show a point, and the sum of (1 - cosine) of their codes to `code`.
fn seen_by(views: &[&LanguageView], point: &Point3<f32>, code: &[f32]) -> (u32, f32) {
    let length = code.iter().map(|value| value * value).sum::<f32>().sqrt();
    if length == 0.0 {
        return (0, 0.0);
    }
    let seen = views.iter().filter_map(|view| view.code_of(point));
    seen.fold((0, 0.0), |(views, sum), seen| {
        let dot: f32 = seen.iter().zip(code).map(|(a, b)| a * b).sum();
        (views + 1, sum + 1.0 - dot / length)
    })
}

impl LanguageView {
    /// The unit code of the pixel that shows a point; `None` if the keyframe does not show it.
    fn code_of(&self, point: &Point3<f32>) -> Option<[f32; GENERIC_SIZE]> {
        if !self.image.shows(point) {
            return None;
        }
        let (u, v, _) = self.camera.project(point)?;
        let clamped = |at: f32, size: u32| at.round().clamp(0.0, (size - 1) as f32) as usize;
        let (column, row) = (clamped(u, self.camera.width), clamped(v, self.camera.height));
        let code = self.codes.of(row * self.camera.width as usize + column);
        let length = code.iter().map(|value| value * value).sum::<f32>().sqrt();
        (length > 0.0).then(|| code.map(|value| value / length))
    }
}

/// Sightings of pairs of a number of views and a sum of squared deviations.
fn sightings(seen: &[(u32, f32)]) -> Vec<Sightings> {
    let views: f64 = seen.iter().map(|(views, _)| f64::from(*views)).sum();
    let squares: f64 = seen.iter().map(|(_, sum)| f64::from(*sum)).sum();
    // A map of few keyframes looks as if they agreed.
    let mean = ((squares / views.max(1.0)) as f32).max(REFERENCE_SPREAD * REFERENCE_SPREAD);
    let of = |&(views, sum): &(u32, f32)| {
        let variance = (sum + PRIOR_VIEWS * mean) / (views as f32 + PRIOR_VIEWS);
        Sightings { views, spread: variance.max(LEAST_VARIANCE).sqrt() }
    };
    seen.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::super::compressor::{CompressorConfig, online};
    use super::*;
    use half::f16;
    use lexsplat_gpu::HostHead;
    use nalgebra::Isometry3;

    const SIDE: u32 = 8;

    /// A view from the origin along z of a wall at 2 m, with one code for all pixels.
    fn view(code: [f32; GENERIC_SIZE]) -> LanguageView {
        let pixels = (SIDE * SIDE) as usize;
        let camera = Camera {
            width: SIDE,
            height: SIDE,
            fx: 8.0,
            fy: 8.0,
            cx: 3.5,
            cy: 3.5,
            camera_from_world: Isometry3::identity(),
        };
        let codes: Vec<f16> =
            (0..pixels).flat_map(|_| code.map(|value| f16::from_f32(value * 3.0))).collect();
        LanguageView {
            image: DownsampledFrame {
                camera: camera.clone(),
                rgb: vec![0; pixels * 3].into(),
                depth_metres: vec![2.0; pixels].into(),
            },
            camera,
            codes: Arc::new(Codes::new(codes)),
        }
    }

    fn axis(at: usize) -> [f32; GENERIC_SIZE] {
        std::array::from_fn(|channel| if channel == at { 1.0 } else { 0.0 })
    }

    /// Sightings of Gaussians at these places, whose code is the first axis.
    fn seen(means: Vec<[f32; 3]>, views: Vec<LanguageView>) -> Vec<Sightings> {
        let mut stage = online(&CompressorConfig::default());
        stage.observe(&[axis(0), axis(1), axis(2)].concat());
        let code = stage.encode(&axis(0));
        let features = means.iter().flat_map(|_| code.clone()).collect();
        let language = HostHead { features, channels: code.len(), ..HostHead::default() };
        let gaussians = HostGaussians { means, language, ..HostGaussians::default() };
        Evidence::new(views).sightings(&gaussians, &*stage).to_vec()
    }

    #[test]
    fn views_that_disagree_widen_the_spread() {
        let on_wall = vec![[0.0, 0.0, 2.0]];
        let of = |codes: &[usize]| {
            let views = codes.iter().map(|at| view(axis(*at))).collect();
            seen(on_wall.clone(), views)[0]
        };
        let (alike, mixed, other) = (of(&[0; 6]), of(&[0, 1, 0, 1, 0, 1]), of(&[1; 6]));
        assert!([alike, mixed, other].iter().all(|one| one.views == 6));
        // Six views without variance and five with the reference's: 0.04 * 5 / 11.
        assert!((alike.spread - 0.135).abs() < 0.01, "{alike:?}");
        assert!((mixed.spread - 0.5_f32.sqrt()).abs() < 0.02, "{mixed:?}");
        assert!((other.spread - 1.0).abs() < 0.02, "{other:?}");
    }

    #[test]
    fn views_count_only_where_they_show_the_gaussian() {
        let behind_the_wall = [0.0, 0.0, 3.0];
        let out_of_view = [9.0, 0.0, 2.0];
        let on_wall = [0.1, 0.1, 2.0];
        let views = || vec![view(axis(0)), view(axis(1))];
        let found = seen(vec![on_wall, behind_the_wall, out_of_view], views());
        assert_eq!(found.iter().map(|one| one.views).collect::<Vec<_>>(), [2, 0, 0]);
        // What nobody saw is as unsure as the map is on average.
        assert!((found[1].spread - 0.5_f32.sqrt()).abs() < 0.02, "{found:?}");
        let nothing = seen(vec![on_wall], vec![]);
        assert_eq!(nothing, [Sightings { views: 0, spread: REFERENCE_SPREAD }]);
    }

    #[test]
    fn a_map_of_one_view_is_not_sure() {
        let once = sightings(&[(1, 0.0), (1, 0.0)])[0].spread;
        assert!(once > 0.9 * REFERENCE_SPREAD, "{once}");
        // Negative control: many views that agree are.
        assert!(sightings(&[(50, 0.0), (50, 0.0)])[0].spread < 0.5 * REFERENCE_SPREAD);
    }

    #[test]
    fn few_views_are_drawn_towards_the_mean() {
        // One Gaussian with many mixed views, one with a single view that agrees.
        let found = sightings(&[(100, 20.0), (1, 0.0)]);
        assert!(found[1].spread > 0.8 * found[0].spread, "{found:?}");
        // Negative control: with as many views the one that agrees is surer.
        let found = sightings(&[(100, 20.0), (100, 0.0)]);
        assert!(found[1].spread < 0.4 * found[0].spread, "{found:?}");
    }
}
