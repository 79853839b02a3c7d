//! Whether a young map is given up for a better beginning.
//!
//! In: which frames were tracked and lost. Out: the lost frame with which the map begins anew. A map that
//! began with a bad frame (over-exposed, dark, a hand before the lens) tracks nothing. While it has only a few
//! frames, each lost one is kept; if the next lost frame agrees with it, these two are the better beginning.

use super::super::frame::Frame;

/// A map with more tracked frames is not given up.
const YOUNG_FRAMES: usize = 10;

/// Counts the frames of a map that may be given up.
#[derive(Debug, Default)]
pub(super) struct YoungMap {
    tracked: usize,
    /// Frames lost since the last one that was tracked.
    lost: usize,
    /// The last lost frame.
    stray: Option<Frame>,
    is_kept: bool,
}

impl YoungMap {
    /// A frame was tracked. Poses that were given are not in doubt.
    pub fn tracked(&mut self, is_estimated: bool) {
        self.tracked += 1;
        self.lost = 0;
        self.stray = None;
        self.is_kept |= !is_estimated || self.tracked > YOUNG_FRAMES;
    }

    /// Another stream goes on with the map: what it shows was believed by the one before.
    pub fn resume(&mut self) {
        self.is_kept |= self.tracked > 1;
        self.stray = None;
    }

    /// Whether the map may begin anew with the last lost frame, if the frame that is lost now agrees with it.
    pub fn may_begin_anew(&self) -> bool {
        !self.is_kept && self.stray.is_some() && self.lost >= self.tracked
    }

    /// The last lost frame, as the beginning of the new map.
    pub fn take_stray(&mut self) -> Option<Frame> {
        self.stray.take()
    }

    /// A frame was lost. Returns whether it is kept.
    pub fn lost(&mut self, frame: &Frame) -> bool {
        self.lost += 1;
        if !self.is_kept {
            self.stray = Some(frame.clone());
        }
        !self.is_kept
    }
}
