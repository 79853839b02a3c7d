//! What keyframes may take of the machine's memory.
//!
//! In: the keyframes. Out: fewer of them, if they take more than `mapper.max_keyframe_mib`: the one goes
//! that others show best. What it has put into the map stays, and frames that were tracked after it stay
//! where they are; the map is not optimised for it any more, and a lost camera is not found by it. It must
//! not touch Gaussians.

use super::super::working::Working;
use super::Mapper;
use super::keyframe::{Keyframe, Sample};
use std::cmp::Reverse;

/// Points of a keyframe that are looked for in the others.
const SAMPLES: f64 = 100.0;

impl Mapper {
    /// Memory that keyframes take, the device's too, bytes.
    pub(super) fn keyframe_bytes(&self) -> u64 {
        self.keyframes.iter().map(Keyframe::bytes).sum()
    }

    /// Lets keyframes go until the others keep to the budget, or one is left.
    pub(super) fn keep_to_budget(&mut self) {
        let limit = self.config.max_keyframe_mib << 20;
        while self.keyframe_bytes() > limit {
            let pictures: Vec<&Working> = self.keyframes.iter().map(|kf| &kf.working).collect();
            let Some(at) = least_missed(&pictures, self.config.window) else { return };
            let frame = self.keyframes[at].frame;
            let (map, sequence) = (self.map.name(), frame.sequence);
            tracing::info!(map, sequence, "mapper.max_keyframe_mib: a keyframe is let go");
            self.trajectory.forget(at, &frame);
            self.tracker.forget_keyframe(sequence);
            self.awaiting_language.retain(|frame| frame.sequence != sequence);
            self.keyframes.remove(at);
            self.moved = true;
        }
    }
}

/// The picture that the others show best; of several the newest, because poses hold on to the oldest. Of
/// the newest `window` only where there are no others, and never the very newest.
fn least_missed(pictures: &[&Working], window: usize) -> Option<usize> {
    let count = pictures.len();
    let older = if count > window { count - window } else { count.saturating_sub(1) };
    let novelty = |at: usize| {
        let sample = Sample::of(&pictures[at].camera, &pictures[at].depth_metres, SAMPLES);
        let others = pictures.iter().enumerate().filter(|(other, _)| *other != at);
        sample.novelty(others.map(|(_, picture)| *picture))
    };
    (0..older)
        .map(|at| (novelty(at), at))
        .min_by(|(a, i), (b, j)| a.total_cmp(b).then(Reverse(i).cmp(&Reverse(j))))
        .map(|(_, at)| at)
}

#[cfg(test)]
mod tests {
    use super::super::keyframe::tests::wall;
    use super::*;

    fn goes(places: &[f32], window: usize) -> Option<usize> {
        let pictures: Vec<Working> = places.iter().map(|metres| wall(*metres)).collect();
        least_missed(&pictures.iter().collect::<Vec<_>>(), window)
    }

    #[test]
    fn what_others_show_goes_first() {
        // Each shows two metres of the wall.
        assert_eq!(goes(&[0.0, 1.0, 2.0, 9.0], 1), Some(1), "between its neighbours");
        assert_eq!(goes(&[0.0, 3.0, 4.0, 5.0], 1), Some(2));
        assert_eq!(goes(&[0.0, 0.0, 9.0, 20.0], 1), Some(1), "of two that are alike the newer");
        assert_eq!(goes(&[0.0, 9.0, 20.0, 9.5], 1), Some(1), "the newest counts as a witness");
    }

    #[test]
    fn the_window_stays_as_long_as_there_are_others() {
        assert_eq!(goes(&[0.0, 9.0, 9.0, 9.0], 3), Some(0), "though nobody else shows it");
        assert_eq!(goes(&[0.0, 9.0, 9.0], 3), Some(1), "nothing but the window");
        assert_eq!(goes(&[0.0], 3), None);
        assert_eq!(goes(&[], 3), None);
    }
}
