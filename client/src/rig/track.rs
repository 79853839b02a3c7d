//! Where one frame of coordinates is in another over time.

use nalgebra::Isometry3;

/// Nothing is concluded from poses farther apart in time, unless they are the same.
const LONGEST_GAP_NANOS: u64 = 1_000_000_000;
/// How far before the first and after the last pose these still hold.
const SLACK_NANOS: u64 = 100_000_000;

/// Poses of a frame in its parent, by time.
#[derive(Clone, Debug)]
pub(super) struct Track {
    pub parent: String,
    poses: Vec<(u64, Isometry3<f64>)>,
    /// The newest pose holds at all times.
    is_fixed: bool,
    moves: bool,
}

impl Track {
    pub(super) fn new(parent: String, is_fixed: bool) -> Self {
        Self { parent, poses: Vec::new(), is_fixed, moves: false }
    }

    /// Adds a pose. A frame that rests takes no memory.
    pub(super) fn add(&mut self, nanos: u64, pose: Isometry3<f64>) {
        if self.is_fixed {
            self.poses = vec![(nanos, pose)];
            return;
        }
        self.moves |= self.poses.last().is_some_and(|(_, last)| *last != pose);
        if let [.., (_, before), (at, last)] = &mut self.poses[..]
            && *at < nanos
            && *before == pose
            && *last == pose
        {
            *at = nanos;
            return;
        }
        let place = self.poses.partition_point(|(other, _)| *other < nanos);
        match self.poses.get_mut(place) {
            Some((at, there)) if *at == nanos => *there = pose,
            _ => self.poses.insert(place, (nanos, pose)),
        }
    }

    /// Whether the frame was seen to move.
    pub(super) fn moves(&self) -> bool {
        self.moves
    }

    /// The time of the newest pose; all times if it rests.
    pub(super) fn reaches(&self) -> u64 {
        let last = self.poses.last().map_or(0, |(nanos, _)| *nanos);
        if self.is_fixed || self.poses.len() == 1 { u64::MAX } else { last }
    }

    /// Forgets what is not needed for later times.
    pub(super) fn forget_before(&mut self, nanos: u64) {
        let first_later = self.poses.partition_point(|(other, _)| *other < nanos);
        self.poses.drain(..first_later.saturating_sub(2));
    }

    /// The pose at a time, between two by interpolation; `None` if none is near.
    pub(super) fn at(&self, nanos: u64) -> Option<Isometry3<f64>> {
        let (first, last) = (self.poses.first()?, self.poses.last()?);
        if self.is_fixed || !self.moves {
            return Some(last.1);
        }
        let later = self.poses.partition_point(|(other, _)| *other < nanos);
        match (later.checked_sub(1).map(|before| self.poses[before]), self.poses.get(later)) {
            (None, _) => (first.0 - nanos <= SLACK_NANOS).then_some(first.1),
            (_, None) => (nanos - last.0 <= SLACK_NANOS).then_some(last.1),
            (Some((from, before)), Some((to, after))) => {
                let gap = to - from;
                if before != *after && gap > LONGEST_GAP_NANOS {
                    return None;
                }
                let share = (nanos - from) as f64 / gap as f64;
                before.try_lerp_slerp(after, share, 1e-9).or(Some(before))
            }
        }
    }
}
