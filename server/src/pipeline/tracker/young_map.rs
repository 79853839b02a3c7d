//! Whether a young map is given up for a better beginning.
//!
//! In: which frames were tracked and lost. Out: the lost frame with which the map begins anew. A map that
//! began with a bad frame (over-exposed, dark, a hand before the lens) tracks nothing. While it has only a few
//! frames, each lost one is kept; if the next lost frame agrees with it, these two are the better beginning.

use super::super::frame::Frame;

/// A map with more tracked frames is not given up.
const YOUNG_FRAMES: usize = 10;
/// A better beginning has at least this share of the first frame's usable pixels.
const USABLE: f64 = 0.8;

/// Counts the frames of a map that may be given up.
#[derive(Debug, Default)]
pub(super) struct YoungMap {
    tracked: usize,
    /// Frames lost since the last one that was tracked.
    lost: usize,
    /// The last lost frame, and the share of its pixels that are usable.
    stray: Option<(Frame, f64)>,
    /// Share of the first frame's pixels that are usable.
    first: f64,
    is_kept: bool,
}

impl YoungMap {
    /// A frame with this share of usable pixels was tracked. Poses that were given are not in doubt.
    pub fn tracked(&mut self, is_estimated: bool, usable: f64) {
        if self.tracked == 0 {
            self.first = usable;
        }
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
        // After many lost frames there is nothing better to wait for.
        let is_better =
            |(_, usable): &(Frame, f64)| *usable >= USABLE * self.first || self.lost > YOUNG_FRAMES;
        !self.is_kept && self.lost >= self.tracked && self.stray.as_ref().is_some_and(is_better)
    }

    /// The last lost frame, as the beginning of the new map.
    pub fn take_stray(&mut self) -> Option<Frame> {
        self.stray.take().map(|(frame, _)| frame)
    }

    /// A frame was lost. Returns whether it is kept.
    pub fn lost(&mut self, frame: &Frame, usable: f64) -> bool {
        self.lost += 1;
        if !self.is_kept {
            self.stray = Some((frame.clone(), usable));
        }
        !self.is_kept
    }
}
