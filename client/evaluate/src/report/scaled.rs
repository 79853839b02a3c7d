//! Times of a report scaled to the probe: what they would be on its reference machine.

use crate::probe::Probe;
use crate::stages::Stage;
use serde::Serialize;
use std::collections::BTreeMap;

/// Times divided by the probe's `relative_time`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scaled {
    /// Seconds per frame until it was acknowledged.
    pub seconds_per_frame: f64,
    /// Seconds from the last acknowledgement until the map was settled.
    pub settle_seconds: f64,
    /// Seconds of streaming and settling per frame.
    pub seconds_per_frame_settled: f64,
    /// Mean of a run of each stage, milliseconds.
    pub stages_mean_ms: BTreeMap<String, f64>,
}

impl Scaled {
    /// Scales seconds of streaming, seconds of settling, and stages of `frames` frames.
    pub(super) fn new(
        probe: &Probe,
        [streaming, settling]: [f64; 2],
        stages: &BTreeMap<String, Stage>,
        frames: u64,
    ) -> Self {
        let by = probe.relative_time;
        let per_frame = |seconds: f64| seconds / by / frames.max(1) as f64;
        let mean_ms = |(name, stage): (&String, &Stage)| (name.clone(), stage.mean_ms / by);
        Self {
            seconds_per_frame: per_frame(streaming),
            settle_seconds: settling / by,
            seconds_per_frame_settled: per_frame(streaming + settling),
            stages_mean_ms: stages.iter().map(mean_ms).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::example::example_report;

    #[test]
    fn on_a_machine_that_takes_twice_as_long_times_count_half() {
        let report = example_report();
        let probe = report.probe.expect("it has one");
        let scaled = |relative_time: f64| {
            let probe = Probe { relative_time, ..probe.clone() };
            Scaled::new(&probe, [8.0, 3.0], &report.stages, 40)
        };
        let half = scaled(2.0);
        assert_eq!((half.seconds_per_frame, half.settle_seconds), (0.1, 1.5));
        assert_eq!(half.seconds_per_frame_settled, 0.1375);
        assert_eq!(half.stages_mean_ms["decode"], 5.0);
        // The reference's times stay as they are.
        assert_eq!(scaled(1.0).seconds_per_frame_settled, 0.275);
        assert_eq!(scaled(1.0).stages_mean_ms["decode"], 10.0);
    }
}
