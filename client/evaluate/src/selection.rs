//! Which frames are rendered and which are asked about.

use crate::recorded::Seen;
use crate::trajectory::StampedPose;
use crate::views::{HELD_OUT_EVERY, SelectedView};
use lexsplat_client::stream::Summary;
use std::collections::BTreeSet;
use std::num::NonZeroUsize;

/// Frames by their positions in the data set.
pub(crate) struct Selection {
    /// Frames with a pose.
    pub tracked: Vec<usize>,
    keyframes: Vec<usize>,
    /// Tracked frames that are no keyframe.
    others: Vec<usize>,
    /// Frames to render that the map was not optimised for.
    held_out: Vec<usize>,
}

impl Selection {
    pub fn of(
        seen: &[Seen],
        estimate: &[StampedPose],
        summary: &Summary,
        hold_out_every: Option<NonZeroUsize>,
    ) -> Self {
        let times: BTreeSet<u64> = estimate.iter().map(|pose| pose.nanos).collect();
        let keys: BTreeSet<u64> = summary.keyframes.iter().copied().collect();
        let tracked: Vec<&Seen> = seen.iter().filter(|seen| times.contains(&seen.nanos)).collect();
        let (keyframes, others): (Vec<&Seen>, Vec<&Seen>) =
            tracked.iter().partition(|seen| keys.contains(&seen.sequence));
        let indices = |frames: Vec<&Seen>| -> Vec<usize> {
            frames.into_iter().map(|seen| seen.index).collect()
        };
        let others = indices(others);
        let held_out = match hold_out_every {
            Some(every) => {
                let is_held_out = |index: &usize| (index + 1).is_multiple_of(every.get());
                others.iter().copied().filter(is_held_out).collect()
            }
            None => others.iter().copied().step_by(HELD_OUT_EVERY).collect(),
        };
        Self { tracked: indices(tracked), keyframes: indices(keyframes), others, held_out }
    }

    /// Frames to render, in order.
    pub fn views(&self) -> Vec<SelectedView> {
        let view = |keyframe| move |index: &usize| SelectedView { index: *index, keyframe };
        let held_out = self.held_out.iter().map(view(false));
        let mut views: Vec<_> = held_out.chain(self.keyframes.iter().map(view(true))).collect();
        views.sort_unstable_by_key(|view| view.index);
        views
    }

    /// Tracked frames that are no keyframe; all tracked ones if there are no others.
    pub fn unseen(&self) -> &[usize] {
        if self.others.is_empty() { &self.tracked } else { &self.others }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Isometry3;

    #[test]
    fn held_out_frames_are_tracked_and_no_keyframes() {
        let pose = |nanos| StampedPose { nanos, world_from_camera: Isometry3::identity() };
        let seen: Vec<Seen> = (0..20)
            .map(|i| Seen { index: i, sequence: 100 + i as u64, nanos: i as u64, truth: None })
            .collect();
        // Frame 3 is lost, 0 and 10 are keyframes.
        let estimate: Vec<StampedPose> = (0..20).filter(|i| *i != 3).map(pose).collect();
        let summary = Summary { keyframes: vec![100, 110], ..Summary::default() };
        let chosen = Selection::of(&seen, &estimate, &summary, None);
        assert_eq!(chosen.tracked.len(), 19);
        let views = chosen.views();
        let held_out: Vec<usize> =
            views.iter().filter(|view| !view.keyframe).map(|view| view.index).collect();
        assert_eq!(held_out, [1, 7, 13, 18]);
        assert_eq!(views.iter().filter(|view| view.keyframe).count(), 2);
        assert!(!chosen.unseen().contains(&3) && !chosen.unseen().contains(&0));
        let every = NonZeroUsize::new(8);
        assert_eq!(Selection::of(&seen, &estimate, &summary, every).held_out, [7, 15]);
        let only_keys = Selection { others: Vec::new(), ..chosen };
        assert_eq!(only_keys.unseen().len(), 19);
    }
}
