//! Whether a young map is given up for a better beginning.
//!
//! In: which frames were tracked and lost. Out: the lost frame with which the map begins anew. A map that
//! began with a bad frame (over-exposed, dark, a hand before the lens) tracks nothing. While it has only a
//! few frames, each lost one is kept; if the next lost frame agrees with it, these two are the better
//! beginning.

use super::super::downsampled_frame::DownsampledFrame;
use super::super::frame::Frame;
use super::quality::{is_blank, is_dark};
use serde::{Deserialize, Serialize};

/// A map with more tracked frames is not given up: two seconds, for which a hand may be before the lens.
const YOUNG_FRAMES: usize = 60;
/// After so many lost frames nothing better is waited for.
const PATIENCE: usize = 10;
/// A better beginning has at least this share of the first frame's usable pixels.
const USABLE: f64 = 0.8;

/// Dark frames that a map does not begin with: a camera needs a second to find its exposure. After them it
/// is the room that is dark.
const DARK_FRAMES: usize = 30;

/// Counts the frames of a map that may be given up.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct YoungMap {
    tracked: usize,
    /// Frames lost since the last one that was tracked.
    lost: usize,
    /// The last lost frame, and the share of its pixels that are usable.
    stray: Option<(Frame, f64)>,
    /// Dark frames before the first one that was tracked.
    dark: usize,
    /// Share of the first frame's pixels that are usable.
    first: f64,
    /// Whether the map is no longer young: it has enough frames, its poses were given, or another stream
    /// goes on with it.
    is_kept: bool,
}

impl YoungMap {
    /// Whether a frame is of no use: it is blank, or a map would begin with it and it is dark. Places that
    /// only a dark frame shows would be seen in the wrong colors.
    pub fn passes_over(&mut self, frame: &DownsampledFrame, is_first: bool) -> bool {
        let waits = is_first && self.dark < DARK_FRAMES && is_dark(frame);
        self.dark += usize::from(waits);
        waits || is_blank(frame)
    }

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
        let is_better =
            |(_, usable): &(Frame, f64)| *usable >= USABLE * self.first || self.lost > PATIENCE;
        !self.is_kept && self.lost >= self.tracked && self.stray.as_ref().is_some_and(is_better)
    }

    /// The last lost frame, as the beginning of the new map.
    pub fn take_stray(&mut self) -> Option<Frame> {
        self.stray.take().map(|(frame, _)| frame)
    }

    /// The last lost frame, if it was kept.
    pub fn stray(&self) -> Option<&Frame> {
        self.stray.as_ref().map(|(frame, _)| frame)
    }

    /// Frames lost since the last one that was tracked.
    pub fn lost_frames(&self) -> usize {
        self.lost
    }

    /// Whether the map is no longer young.
    pub fn is_kept(&self) -> bool {
        self.is_kept
    }

    /// A frame was lost. Returns whether it is kept; one that is held out cannot begin a map.
    pub fn lost(&mut self, frame: &Frame, usable: f64) -> bool {
        self.lost += 1;
        let may_begin = !self.is_kept && !frame.held_out;
        if may_begin {
            self.stray = Some((frame.clone(), usable));
        }
        may_begin
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::pixel_frame;
    use nalgebra::Isometry3;

    fn frame(held_out: bool) -> Frame {
        Frame { held_out, ..pixel_frame() }
    }

    /// A map with this many tracked frames, then as many lost ones as given, all with their usable shares.
    fn begins_anew(tracked: &[f64], lost: &[f64]) -> bool {
        let mut young = YoungMap::default();
        tracked.iter().for_each(|usable| young.tracked(true, *usable));
        lost.iter().for_each(|usable| {
            young.lost(&frame(false), *usable);
        });
        young.may_begin_anew()
    }

    #[test]
    fn a_map_begins_anew_when_as_many_frames_are_lost_as_were_tracked() {
        assert!(begins_anew(&[0.5], &[0.9]));
        assert!(!begins_anew(&[0.5], &[]), "nothing is lost");
        assert!(!begins_anew(&[0.5; 3], &[0.9; 2]), "most were tracked");
        assert!(begins_anew(&[0.5; 3], &[0.9; 3]));
        assert!(begins_anew(&[0.5; 60], &[0.9; 60]));
        assert!(!begins_anew(&[0.5; 61], &[0.9; 99]), "it is no longer young");
        assert!(!begins_anew(&[0.9], &[0.5]), "the first frame shows more");
        assert!(begins_anew(&[0.9], &[0.5; 11]), "nothing better comes");
    }

    #[test]
    fn a_map_begins_in_the_light_unless_it_stays_dark() {
        let frame = |value: u8| DownsampledFrame {
            rgb: [value; 3].into(),
            ..DownsampledFrame::new(&pixel_frame(), &Isometry3::identity(), 1)
        };
        let mut young = YoungMap::default();
        assert!(young.passes_over(&frame(12), true), "dark");
        assert!(!young.passes_over(&frame(12), false), "a map that has begun goes on in the dark");
        assert!(!young.passes_over(&frame(20), true), "light");
        (1..DARK_FRAMES).for_each(|_| assert!(young.passes_over(&frame(12), true)));
        assert!(!young.passes_over(&frame(12), true), "a dark room");
        assert!(young.passes_over(&frame(2), true), "black");
    }

    #[test]
    fn what_is_not_in_doubt_is_not_given_up() {
        let mut given = YoungMap::default();
        given.tracked(false, 0.0);
        assert!(!given.lost(&frame(false), 1.0) && !given.may_begin_anew(), "a given pose");
        let mut resumed = YoungMap::default();
        (0..2).for_each(|_| resumed.tracked(true, 1.0));
        resumed.resume();
        (0..2).for_each(|_| assert!(!resumed.lost(&frame(false), 1.0)));
        assert!(!resumed.may_begin_anew(), "another stream's map");
        let mut held_out = YoungMap::default();
        held_out.tracked(true, 1.0);
        assert!(!held_out.lost(&frame(true), 1.0) && !held_out.may_begin_anew(), "held out");
        assert!(
            held_out.lost(&frame(false), 1.0) && held_out.may_begin_anew(),
            "and another is not"
        );
    }
}
