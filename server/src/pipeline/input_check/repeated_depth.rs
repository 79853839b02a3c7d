//! Finds frames whose depth image is that of an earlier frame.
//!
//! In: samples of frames. Out: whether a frame's depth repeats while its color does not, and a warning when
//! that is certain. A driver repeats depth when its depth camera is slower than the color camera, or has
//! stopped. Such a depth says where the camera was, not where it is.

use super::super::input_warning::{InputProblem, InputWarning};
use super::small_frame::Glance;
use serde::{Deserialize, Serialize};

/// Difference of brightness, of 255, from which on color has changed: more than noise.
const CHANGED: f32 = 4.0;
/// Frames with repeated depth after which it is told.
const CERTAIN: usize = 3;
/// The same if depth is one number everywhere.
const CERTAIN_FLAT: usize = 30;

/// Compares each frame with the first one that had its depth.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(super) struct RepeatedDepthCheck {
    first: Option<Glance>,
    /// Frames that repeated a depth image,
    repeated: usize,
    /// and those of them whose depth is one number everywhere.
    flat: usize,
    is_told: bool,
}

impl RepeatedDepthCheck {
    /// Whether a frame has the depth of an earlier frame, but not its color.
    pub fn repeats(&mut self, glance: &Glance) -> bool {
        let Some(first) = self.first.as_ref().filter(|first| glance.has_depth_of(first)) else {
            self.first = Some(glance.clone());
            return false;
        };
        let repeats = glance.has_depth() && glance.brightness_change(first) >= CHANGED;
        // A rendered camera may slide along a wall. Many such frames are told all the same.
        let is_flat = glance.is_flat();
        self.repeated += usize::from(repeats);
        self.flat += usize::from(repeats && is_flat);
        repeats && !is_flat
    }

    /// Says, once, that depth repeats.
    pub fn warning(&mut self) -> Option<InputWarning> {
        let is_certain = self.repeated - self.flat >= CERTAIN || self.flat >= CERTAIN_FLAT;
        if !is_certain || std::mem::replace(&mut self.is_told, true) {
            return None;
        }
        let message = "Depth stays exactly the same while color changes: the sender repeats old depth images, or makes \
                       them up. Poses from them are wrong, and the map is not extended with repeated ones. Send a \
                       frame only when both images are new.";
        Some(InputWarning { problem: InputProblem::RepeatedDepth, message: message.to_owned() })
    }
}
