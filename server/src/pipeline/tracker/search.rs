//! The search for the pose of one frame: the best result so far, and whether it ends the search.
//!
//! In: results of alignments from several starts. Out: the best believable one. Two results at one pose
//! confirm each other if at least one of them started from features, because matches to two keyframes, or
//! matches and a prediction, do not err together.

use super::super::keyframes::Keyframe;
use super::candidate::PoseCandidate;
use super::config::TrackerConfig;
use super::frame_aligner::distance;
use super::judge::Judge;
use super::motion::Expected;
use lexsplat_pictures::{FeaturePose, Features};
use nalgebra::Isometry3;

/// Two poses nearer than this are the same, metres,
const SAME_METRES: f64 = 0.01;
/// and radians.
const SAME_RADIANS: f64 = 0.01;

/// Surfaces agree less at a pose if this share more of the pixels contradicts it in depth.
const LESS_DEPTH: f64 = 0.02;

/// The first so many lost frames start from anywhere,
const SEARCHED_FAR: usize = 3;
/// and after them one in so many.
const FAR_EVERY: usize = 5;

/// Whether a frame may start from anywhere, after so many lost ones. That takes many times as long as
/// tracking, so a camera that stays lost does it now and then.
pub(super) fn is_searched_far(lost_frames: usize) -> bool {
    lost_frames < SEARCHED_FAR || lost_frames.is_multiple_of(FAR_EVERY)
}

/// Where an alignment started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Origin {
    /// Near where the camera is expected.
    Prediction,
    /// From the robot's own estimate while the camera is lost.
    Guess,
    /// From features shared with a keyframe.
    Features,
    /// From a pose far along the motion, or that of a keyframe that looks alike.
    Far,
}

/// Collects the results of alignments from several starts.
pub(super) struct Search<'a> {
    config: &'a TrackerConfig,
    judge: &'a Judge,
    sequence: u64,
    /// Where the camera is expected; `None` while it is lost.
    expected: Option<Expected>,
    /// Results that another one may confirm.
    results: Vec<(Origin, PoseCandidate)>,
    best: Option<PoseCandidate>,
    is_done: bool,
}

impl<'a> Search<'a> {
    pub fn new(
        config: &'a TrackerConfig,
        judge: &'a Judge,
        sequence: u64,
        expected: Option<Expected>,
    ) -> Self {
        let results = Vec::new();
        Self { config, judge, sequence, expected, results, best: None, is_done: false }
    }

    /// Adds the result of an alignment.
    pub fn add(&mut self, origin: Origin, found: PoseCandidate) {
        let (config, quality) = (self.config, &found.quality);
        tracing::debug!(self.sequence, ?origin, ?quality, exposure = ?found.exposure);
        let is_accepted = match origin {
            Origin::Prediction => quality.is_tracked(config),
            Origin::Guess | Origin::Features | Origin::Far => quality.is_relocalised(config),
        };
        // Colors may differ for other reasons, such as reflections and automatic tone curves.
        let is_likely = quality.is_aligned(config)
            && (1.0 - quality.agreement <= config.confirmed_disagreement
                || 1.0 - quality.depth_agreement <= config.max_disagreement);
        let is_confirmed = is_likely
            && self.results.iter().any(|(other, result)| {
                [*other, origin].contains(&Origin::Features)
                    && is_same(&result.world_from_camera, &found.world_from_camera)
            });
        if is_likely {
            self.results.push((origin, found));
        }
        let is_believed = is_accepted && self.judge.is_believable(quality, config);
        if !is_confirmed && !is_believed {
            return;
        }
        let jumped = matches!(origin, Origin::Features | Origin::Far) && self.is_elsewhere(&found);
        let found = PoseCandidate { jumped, ..found };
        let is_known = self.expected.is_some();
        if self.best.as_ref().is_some_and(|best| is_known && is_alias(best, &found)) {
            return;
        }
        self.is_done |= is_confirmed || self.judge.ends_search(quality, config);
        let is_better = |best: &PoseCandidate| quality.agreement > best.quality.agreement;
        if is_confirmed || self.best.as_ref().is_none_or(is_better) {
            self.best = Some(found);
        }
    }

    /// Where the camera is expected; `None` while it is lost.
    pub fn expected(&self) -> Option<&Isometry3<f64>> {
        self.expected.as_ref().map(|expected| &expected.world_from_camera)
    }

    /// Matches features with those of keyframes, until they put the camera where a result is. That is
    /// confirmed then, as if an alignment from the features had ended there.
    pub fn confirm(&mut self, features: &Features, keyframes: &[&Keyframe]) {
        for keyframe in keyframes {
            if self.is_done || self.results.is_empty() {
                return;
            }
            let matched = FeaturePose::find(features, &keyframe.features);
            if let Some(matched) = matched.filter(FeaturePose::is_certain) {
                let world_from_keyframe = &keyframe.frame.world_from_camera;
                self.add_matched(&(world_from_keyframe * matched.keyframe_from_camera));
            }
        }
    }

    /// Adds where matched features alone put the camera.
    fn add_matched(&mut self, world_from_camera: &Isometry3<f64>) {
        let same = |(_, result): &&(Origin, PoseCandidate)| {
            is_same(&result.world_from_camera, world_from_camera)
        };
        let Some((origin, found)) = self.results.iter().find(same) else { return };
        let jumped = *origin == Origin::Guess && self.is_elsewhere(found);
        self.best = Some(PoseCandidate { jumped, ..*found });
        self.is_done = true;
    }

    /// Whether a pose is farther from the expected one than the motion explains.
    fn is_elsewhere(&self, found: &PoseCandidate) -> bool {
        self.expected.is_none_or(|expected| {
            let (metres, radians) = distance(&expected.world_from_camera, &found.world_from_camera);
            metres > self.config.rerender_metres + expected.metres
                || radians > self.config.rerender_radians + expected.radians
        })
    }

    /// Whether a result is convincing, so that no other start needs to be tried.
    pub fn is_done(&self) -> bool {
        self.is_done
    }

    /// Whether a result is believable.
    pub fn has_found(&self) -> bool {
        self.best.is_some()
    }

    /// The believable result that agrees best with the map.
    pub fn best(self) -> Option<PoseCandidate> {
        self.best
    }
}

/// Whether a pose far from where the camera is expected only looks like one that is not: colors may agree
/// there too, as on tiles, but surfaces agree less.
fn is_alias(expected: &PoseCandidate, elsewhere: &PoseCandidate) -> bool {
    let [here, there] = [expected, elsewhere].map(|found| found.quality.depth_agreement);
    !expected.jumped && elsewhere.jumped && there < here - LESS_DEPTH
}

fn is_same(a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
    let (metres, radians) = distance(a, b);
    metres < SAME_METRES && radians < SAME_RADIANS
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::tracker::quality::AlignmentQuality;

    fn result(agreement: f64, x: f64) -> PoseCandidate {
        with_depth(agreement, agreement, x)
    }

    fn with_depth(agreement: f64, depth_agreement: f64, x: f64) -> PoseCandidate {
        let quality = AlignmentQuality { agreement, depth_agreement, ..AlignmentQuality::PERFECT };
        let world_from_camera = Isometry3::translation(x, 0.0, 0.0);
        PoseCandidate { quality, ..PoseCandidate::given(world_from_camera) }
    }

    /// The x of the pose that is found, and whether the search is done.
    fn found(results: &[(Origin, f64, f64)]) -> (Option<f64>, bool) {
        let (config, judge) = (TrackerConfig::default(), Judge::default());
        let mut search = Search::new(&config, &judge, 0, None);
        for (origin, agreement, x) in results {
            search.add(*origin, result(*agreement, *x));
        }
        let is_done = search.is_done();
        (search.best().map(|best| best.world_from_camera.translation.x), is_done)
    }

    #[test]
    fn a_doubtful_pose_is_believed_if_features_confirm_it() {
        use Origin::{Far, Features, Prediction};
        assert_eq!(found(&[(Prediction, 0.99, 1.0)]), (Some(1.0), true));
        assert_eq!(found(&[(Prediction, 0.7, 1.0)]), (None, false), "alone it is not");
        assert_eq!(found(&[(Prediction, 0.7, 1.0), (Features, 0.7, 1.001)]), (Some(1.001), true));
        assert_eq!(found(&[(Features, 0.7, 1.0), (Features, 0.7, 1.001)]), (Some(1.001), true));
        assert_eq!(
            found(&[(Prediction, 0.7, 1.0), (Features, 0.7, 1.1)]),
            (None, false),
            "elsewhere"
        );
        assert_eq!(
            found(&[(Prediction, 0.7, 1.0), (Far, 0.7, 1.0)]),
            (None, false),
            "both may slide"
        );
        assert_eq!(
            found(&[(Features, 0.5, 1.0), (Features, 0.5, 1.0)]),
            (None, false),
            "too little"
        );
        let two = [(Prediction, 0.87, 1.0), (Features, 0.9, 2.0)];
        assert_eq!(found(&two), (Some(2.0), false), "the better of two");
        let confirmed = [(Prediction, 0.87, 1.0), (Features, 0.8, 2.0), (Features, 0.8, 2.0)];
        assert_eq!(found(&confirmed), (Some(2.0), true), "two are worth more than a better one");
    }

    #[test]
    fn matched_features_confirm_a_result_at_the_same_place_only() {
        let (config, judge) = (TrackerConfig::default(), Judge::default());
        let found = |agreement: f64, matched: f64| {
            let mut search = Search::new(&config, &judge, 0, None);
            search.add(Origin::Prediction, result(agreement, 1.0));
            assert!(!search.is_done(), "alone it is not");
            search.add_matched(&Isometry3::translation(matched, 0.0, 0.0));
            let is_done = search.is_done();
            (search.best().map(|best| best.world_from_camera.translation.x), is_done)
        };
        assert_eq!(found(0.7, 1.005), (Some(1.0), true));
        assert_eq!(found(0.7, 1.02), (None, false), "elsewhere");
        assert_eq!(found(0.5, 1.0), (None, false), "too little agrees to be likely");
    }

    #[test]
    fn other_colors_do_not_matter_where_features_and_depth_agree() {
        let (config, judge) = (TrackerConfig::default(), Judge::default());
        let found = |depth_agreement: f64| {
            let quality = AlignmentQuality {
                agreement: 0.4,
                intensity: 0.4,
                depth_agreement,
                ..AlignmentQuality::PERFECT
            };
            let result = PoseCandidate { quality, ..PoseCandidate::given(Isometry3::identity()) };
            let mut search = Search::new(&config, &judge, 0, None);
            search.add(Origin::Features, result);
            assert!(!search.has_found(), "alone it is not believed");
            search.add(Origin::Features, result);
            search.has_found()
        };
        assert!(found(0.99));
        assert!(!found(0.7), "the surfaces differ too");
    }

    #[test]
    fn tiles_that_look_like_others_are_no_jump() {
        let (config, judge) = (TrackerConfig::default(), Judge::default());
        let found = |depth_there: f64, metres: f64| {
            let world_from_camera = Isometry3::identity();
            let expected = Expected { world_from_camera, metres, radians: 0.0 };
            let mut search = Search::new(&config, &judge, 0, Some(expected));
            search.add(Origin::Prediction, with_depth(0.87, 1.0, 0.0));
            (0..2).for_each(|_| search.add(Origin::Features, with_depth(0.9, depth_there, 0.6)));
            search.best().map(|best| best.world_from_camera.translation.x)
        };
        assert_eq!(found(0.9, 0.05), Some(0.0), "surfaces agree less");
        assert_eq!(found(1.0, 0.05), Some(0.6), "surfaces agree as well: the prediction was wrong");
        assert_eq!(found(0.9, 0.7), Some(0.6), "it is where the camera may be");
    }

    #[test]
    fn features_that_lead_to_the_expected_place_are_no_jump() {
        let (config, judge) = (TrackerConfig::default(), Judge::default());
        let jumped = |expected: Option<(f64, f64)>| {
            let expected = expected.map(|(x, metres)| Expected {
                world_from_camera: Isometry3::translation(x, 0.0, 0.0),
                metres,
                radians: 0.0,
            });
            let mut search = Search::new(&config, &judge, 0, expected);
            search.add(Origin::Features, result(0.99, 1.0));
            search.best().map(|best| best.jumped)
        };
        assert_eq!(jumped(Some((0.99, 0.0))), Some(false));
        assert_eq!(jumped(Some((0.5, 0.1))), Some(true), "it was expected elsewhere");
        assert_eq!(jumped(Some((0.5, 0.6))), Some(false), "it may only have stopped");
        assert_eq!(jumped(None), Some(true), "it was lost");
    }
}
