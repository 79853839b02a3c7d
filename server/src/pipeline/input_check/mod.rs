//! Says what is wrong with the frames of a stream, if it can be seen.
//!
//! In: frames as they were sent. Out: warnings, each once. The first frames that differ from each other are
//! compared, at 160 columns: whether poses and depths fit together (`pose_check.rs`), whether depth lies on
//! the color image (`registration.rs`), and whether depths are of a size that a room can have. Each check
//! tries the usual mistakes, and speaks only if one of them explains nearly all frames far better than what
//! was sent. Depth that repeats while color changes is looked for as long as the stream goes on
//! (`repeated_depth.rs`), and a stream without any depth is told of. The checks refuse nothing and do not
//! touch the map.

mod edges;
mod fit;
mod message;
mod pose_check;
mod reading;
mod registration;
mod repeated_depth;
mod small_frame;
#[cfg(test)]
mod tests;

use super::frame::Frame;
use super::input_warning::InputWarning;
use super::quantile::median;
use pose_check::PoseCheck;
use registration::RegistrationCheck;
use repeated_depth::RepeatedDepthCheck;
use serde::{Deserialize, Serialize};
use small_frame::{Glance, SmallFrame};
use std::collections::VecDeque;

/// Frames that are examined at most; each differs from the one before.
const EXAMINED: usize = 100;
/// A frame is compared with the ones that were examined so many before it.
const PARTNERS: [usize; 2] = [1, 3];
/// Frames after which poses are judged even if too few frames had edges to see where depth is, and after
/// which a frame without a pose means that there is nothing to judge.
const PATIENCE: usize = 16;
/// If depth is displaced by more than this share of the width, nothing can be said about the poses.
const MISLEADING: f32 = 0.08;
/// Frames that a verdict on the size of depths needs.
const LEAST_SIZES: usize = 4;
/// Rooms whose median depth is outside this range do not exist, metres.
const ROOM_METRES: std::ops::Range<f32> = 0.05..50.0;

/// The examination of one stream.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct InputCheck {
    newest: Option<Glance>,
    examined: usize,
    /// The last frames that were examined, the newest first.
    partners: VecDeque<SmallFrame>,
    /// Median depth of each examined frame, metres as sent.
    sizes: Option<Vec<f32>>,
    /// Each check ends with its first warning, or when it has seen enough.
    poses: Option<PoseCheck>,
    registration: Option<RegistrationCheck>,
    repeated_depth: RepeatedDepthCheck,
    /// Frames so far if none had any depth; `None` once one had, or it was told.
    without_depth: Option<usize>,
}

/// What was seen in one frame.
pub(super) struct Examined {
    /// Whether its depth is that of an earlier frame, while its color is not.
    pub repeats_depth: bool,
    /// What can be said now for the first time.
    pub warnings: Vec<InputWarning>,
}

impl InputCheck {
    pub fn new() -> Self {
        Self {
            newest: None,
            examined: 0,
            partners: VecDeque::new(),
            sizes: Some(Vec::new()),
            poses: Some(PoseCheck::new()),
            registration: Some(RegistrationCheck::new()),
            repeated_depth: RepeatedDepthCheck::default(),
            without_depth: Some(0),
        }
    }

    /// Examines a frame.
    pub fn examine(&mut self, frame: &Frame) -> Examined {
        let glance = Glance::new(frame);
        let repeats_depth = self.repeated_depth.repeats(&glance);
        let mut warnings: Vec<_> = self.repeated_depth.warning().into_iter().collect();
        warnings.extend(self.check_depth(&glance));
        warnings.extend(self.examine_new(frame, glance));
        Examined { repeats_depth, warnings }
    }

    /// Examines a frame if it shows something new.
    fn examine_new(&mut self, frame: &Frame, glance: Glance) -> Vec<InputWarning> {
        if self.is_done() {
            return Vec::new();
        }
        let is_new = self.newest.as_ref().is_none_or(|newest| !glance.is_like(newest));
        if !is_new || !glance.has_depth() {
            return Vec::new();
        }
        self.newest = Some(glance);
        self.examined += 1;
        let frame = SmallFrame::new(frame);
        let edges = self.check_edges(&frame);
        let warnings = [edges, self.check_poses(&frame), self.check_size(&frame)];
        self.partners.push_front(frame);
        self.partners.truncate(PARTNERS[1]);
        if self.is_done() {
            self.partners.clear();
            (self.poses, self.registration) = (None, None);
        }
        warnings.into_iter().flatten().flatten().collect()
    }

    /// Whether there is any depth at all.
    fn check_depth(&mut self, glance: &Glance) -> Option<InputWarning> {
        let frames = self.without_depth? + 1;
        let is_told = frames >= PATIENCE;
        self.without_depth = (!is_told && !glance.has_any_depth()).then_some(frames);
        (is_told && !glance.has_any_depth()).then(|| message::of_no_depth(frames))
    }

    fn is_done(&self) -> bool {
        self.examined >= EXAMINED || (self.poses.is_none() && self.registration.is_none())
    }

    /// Whether poses and depths fit together.
    fn check_poses(&mut self, frame: &SmallFrame) -> Option<Vec<InputWarning>> {
        let check = self.poses.as_mut()?;
        for before in PARTNERS {
            if let Some(partner) = self.partners.get(before - 1) {
                check.add(partner, frame);
            }
        }
        // Depth that is not where it should be looks like wrong poses.
        if self.registration.as_ref().is_some_and(|registration| !registration.is_certain())
            && self.examined < PATIENCE
        {
            return None;
        }
        let verdict = check.verdict();
        let has_none = self.examined >= PATIENCE && frame.world_from_camera.is_none();
        if verdict.is_some() || check.is_full() || has_none {
            self.poses = None;
        }
        verdict.map(|verdict| message::of_poses(&verdict))
    }

    /// Whether depths are of a size that a room can have. Poses that were given say more about it.
    fn check_size(&mut self, frame: &SmallFrame) -> Option<Vec<InputWarning>> {
        if frame.world_from_camera.is_some() {
            return None;
        }
        let sizes = self.sizes.as_mut()?;
        sizes.push(frame.median_depth_metres()?);
        let size = median(sizes)?;
        if sizes.len() < LEAST_SIZES || ROOM_METRES.contains(&size) {
            return None;
        }
        self.sizes = None;
        Some(vec![message::of_size(size)])
    }

    /// Whether depth lies on the color image.
    fn check_edges(&mut self, frame: &SmallFrame) -> Option<Vec<InputWarning>> {
        let check = self.registration.as_mut()?;
        check.add(frame);
        let verdict = check.verdict();
        if verdict.is_some() || check.is_full() {
            self.registration = None;
        }
        let verdict = verdict?;
        if verdict.placement.displacement() > MISLEADING {
            self.poses = None;
        }
        Some(vec![message::of_registration(&verdict)])
    }
}
