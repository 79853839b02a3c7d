//! The times of a map's frames, which always increase.
//!
//! In: the times that a map's senders gave their frames, in order, nanoseconds. Out: the times that the map
//! uses, strictly ascending, as programs expect that read a trajectory. Times that increase already stay as
//! they are. Nothing here reads a clock: the frames of a log give the same times when they are replayed.

use serde::{Deserialize, Serialize};

/// Time between frames before two good ones came: 30 frames per second.
const FIRST_INTERVAL: u64 = 1_000_000_000 / 30;
/// A longer time between two frames is a pause, not an interval.
const LONGEST_INTERVAL: u64 = 1_000_000_000;

/// The newest times of a map.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct FrameTimes {
    /// The newest time that was given.
    given: Option<u64>,
    /// The newest time that the map uses.
    newest: Option<u64>,
    /// The last time between two frames that increased.
    interval: u64,
    /// Whether the newest time that was given is earlier than the one that the map uses.
    is_behind: bool,
}

impl Default for FrameTimes {
    fn default() -> Self {
        Self { given: None, newest: None, interval: FIRST_INTERVAL, is_behind: false }
    }
}

impl FrameTimes {
    /// The time of the next frame: the given one, if it is later than the newest. 0 is a time that was not
    /// set, and comes an interval after the newest. If a clock was set back, the map's times advance at half
    /// the speed of the sender's until they agree again, so that the motion between frames stays plausible
    /// and the times become right again.
    pub fn next(&mut self, given: u64) -> u64 {
        if given > 0 {
            let interval = given.saturating_sub(self.given.unwrap_or(given));
            if (1..=LONGEST_INTERVAL).contains(&interval) {
                self.interval = interval;
            }
            self.given = Some(given);
        }
        let next = match self.newest {
            Some(newest) if given <= newest || self.is_behind => {
                let step = if given == 0 { self.interval } else { self.interval / 2 };
                given.max(newest.saturating_add(step.max(1)))
            }
            _ => given,
        };
        self.is_behind = next != given;
        self.newest = Some(next);
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: u64 = 33_333_333;
    const START: u64 = 1_700_000_000_000_000_000;

    fn times(given: impl IntoIterator<Item = u64>) -> Vec<u64> {
        let mut times = FrameTimes::default();
        given.into_iter().map(|given| times.next(given)).collect()
    }

    fn ascend(times: &[u64]) -> bool {
        times.windows(2).all(|pair| pair[0] < pair[1])
    }

    #[test]
    fn times_that_increase_stay_as_they_are() {
        // One nanosecond, an hour and odd intervals alike.
        let good = [0, 1, 2, START, START + 7, START + 3_600 * 1_000_000_000, u64::MAX];
        assert_eq!(times(good), good);
    }

    #[test]
    fn other_times_are_made_to_increase() {
        let zeros = times([0; 4]);
        assert_eq!(zeros, [0, FIRST_INTERVAL, 2 * FIRST_INTERVAL, 3 * FIRST_INTERVAL]);
        let given: Vec<u64> = (0..8).map(|n| START + n / 2 * FRAME).collect();
        assert!(!ascend(&given), "negative control");
        let twice = times(given.clone());
        assert!(ascend(&twice), "{twice:?}");
        assert!((0..4).all(|n| twice[2 * n] == given[2 * n]), "the first of two keeps its time");
        assert!(ascend(&times([START; 5])), "they stand still");
        assert!(
            ascend(&times([5, 4, 3, 2, 1])),
            "they run backwards, faster than half an interval"
        );
        let one_unset = times([START, START + FRAME, 0, START + 3 * FRAME]);
        assert_eq!(one_unset[2..], [START + 2 * FRAME, START + 3 * FRAME]);
    }

    #[test]
    fn after_a_clock_was_set_back_times_become_right_again() {
        const BACK: u64 = 3_000_000_000;
        let given: Vec<u64> =
            (0..300).map(|n| START + n * FRAME - if n >= 5 { BACK } else { 0 }).collect();
        assert!(!ascend(&given), "negative control");
        let found = times(given.clone());
        assert!(ascend(&found));
        assert_eq!(found[..5], given[..5]);
        assert_ne!(found[180], given[180], "not yet after five seconds");
        assert_eq!(found[190..], given[190..], "after six seconds they are");
        let shortest = found.windows(2).map(|pair| pair[1] - pair[0]).min();
        assert!(shortest > Some(FRAME / 4), "no frame comes at once: {shortest:?}");
    }
}
