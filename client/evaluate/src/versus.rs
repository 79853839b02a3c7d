//! **Two builds of the server on one data set**: ratios of what their reports measured, with the
//! spread over rounds.
//!
//! In: a pair of reports for each round, measured one after the other. Out: a [`Comparison`], as
//! numbers and as a table. A build that lacks a quantity has none, and neither a ratio.

use crate::report::Report;
use crate::statistics::{geometric_mean, mean};
use crate::table::Column;
use serde::Serialize;
use std::collections::BTreeSet;

const MEBIBYTE: f64 = 1048576.0;
/// What stands for a missing value.
const MISSING: &str = "-";

/// Two builds, "this" and "that", on one data set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Name of the data set.
    pub dataset: String,
    /// Number of frames sent.
    pub frames: u64,
    /// Number of rounds.
    pub rounds: usize,
    /// The first build: path of its binary.
    pub this: String,
    /// The second build.
    pub that: String,
    /// What was measured of both or of one, in the order of the table.
    pub quantities: Vec<Quantity>,
}

/// A quantity of both builds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Quantity {
    /// Its name, with its unit.
    pub what: String,
    /// Values of the first build, one for each round; null if it does not measure it.
    pub this: Vec<Option<f64>>,
    /// Values of the second build.
    pub that: Vec<Option<f64>>,
    /// The first build over the second.
    pub ratio: Option<Ratio>,
    /// The same of times that are scaled to the probe; null for what is no time by the clock on the
    /// wall.
    pub scaled_ratio: Option<Ratio>,
    /// Digits after the point in the table.
    #[serde(skip)]
    decimals: usize,
}

/// The ratio of two builds over the rounds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ratio {
    /// Geometric mean of the rounds' ratios.
    pub mean: f64,
    /// The lowest ratio of a round.
    pub lowest: f64,
    /// The highest ratio of a round.
    pub highest: f64,
    /// Number of rounds that have one.
    pub rounds: usize,
}

impl Ratio {
    /// Over rounds; nothing if no round has a ratio. Equal values have a ratio of 1, also if they
    /// are 0 or infinite; other values have none with 0.
    pub fn of(pairs: impl Iterator<Item = (Option<f64>, Option<f64>)>) -> Option<Self> {
        let ratios: Vec<f64> = pairs.filter_map(|(this, that)| ratio(this?, that?)).collect();
        Some(Self {
            mean: geometric_mean(ratios.iter().copied())?,
            lowest: ratios.iter().copied().fold(f64::INFINITY, f64::min),
            highest: ratios.iter().copied().fold(0.0, f64::max),
            rounds: ratios.len(),
        })
    }
}

fn ratio(this: f64, that: f64) -> Option<f64> {
    if this == that {
        return Some(1.0);
    }
    Some(this / that).filter(|ratio| ratio.is_finite() && *ratio > 0.0)
}

/// Whether a quantity is scaled to the probe: a time by the clock on the wall.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Unit {
    Time,
    Other,
}

/// A quantity of a report: its name, digits after the point, unit, and value.
type Measured<'a> = (&'a str, usize, Unit, &'a dyn Fn(&Report) -> Option<f64>);

impl Comparison {
    /// Compares the reports of all rounds, the first build's first. `builds` are the paths of the
    /// binaries.
    ///
    /// # Panics
    /// If there is no round.
    pub fn new(builds: [String; 2], rounds: &[[Report; 2]]) -> Self {
        let first = &rounds.first().expect("a comparison has a round")[0];
        let quantities = speed(rounds)
            .into_iter()
            .chain(stages(rounds))
            .chain(cost(rounds))
            .chain(quality(rounds))
            .filter(|one| one.this.iter().chain(&one.that).any(Option::is_some));
        let [this, that] = builds;
        Self {
            dataset: first.dataset.clone(),
            frames: first.frames,
            rounds: rounds.len(),
            this,
            that,
            quantities: quantities.collect(),
        }
    }

    /// Of equal builds, one row in so many has all its ratios on the same side of 1 by chance.
    pub fn one_in(&self) -> u64 {
        1 << (self.rounds - 1).min(62)
    }

    /// The columns of the table.
    pub fn columns() -> [Column<'static>; 7] {
        [
            Column::left("what"),
            Column::right("this"),
            Column::right("that"),
            Column::right("this/that"),
            Column::right("lowest, highest"),
            Column::right("scaled"),
            Column::right("lowest, highest (scaled)"),
        ]
    }

    /// The rows of the table: means of the values, then ratios.
    pub fn rows(&self) -> Vec<Vec<String>> {
        self.quantities.iter().map(Quantity::row).collect()
    }
}

impl Quantity {
    fn new(rounds: &[[Report; 2]], (what, decimals, unit, value): Measured<'_>) -> Self {
        let of = |build: usize| -> Vec<Option<f64>> {
            rounds.iter().map(|round| value(&round[build])).collect()
        };
        let (this, that) = (of(0), of(1));
        let pairs = || this.iter().copied().zip(that.iter().copied());
        let scaled = |build: usize| {
            let by = move |round: &[Report; 2]| Some(round[build].probe.as_ref()?.relative_time);
            rounds.iter().map(move |round| Some(value(&round[build])? / by(round)?))
        };
        Self {
            what: what.to_owned(),
            ratio: Ratio::of(pairs()),
            scaled_ratio: match unit {
                Unit::Time => Ratio::of(scaled(0).zip(scaled(1))),
                Unit::Other => None,
            },
            this,
            that,
            decimals,
        }
    }

    fn row(&self) -> Vec<String> {
        let value = |values: &[Option<f64>]| match mean(values.iter().copied().flatten()) {
            Some(value) => format!("{value:.*}", self.decimals),
            None => MISSING.to_owned(),
        };
        let mut row = vec![self.what.clone(), value(&self.this), value(&self.that)];
        for ratio in [self.ratio, self.scaled_ratio] {
            row.extend(match ratio {
                Some(Ratio { mean, lowest, highest, .. }) => {
                    [format!("{mean:.3}"), format!("{lowest:.3}, {highest:.3}")]
                }
                None => [MISSING.to_owned(), MISSING.to_owned()],
            });
        }
        row
    }
}

fn listed(rounds: &[[Report; 2]], measured: &[Measured<'_>]) -> Vec<Quantity> {
    measured.iter().map(|one| Quantity::new(rounds, *one)).collect()
}

fn speed(rounds: &[[Report; 2]]) -> Vec<Quantity> {
    listed(
        rounds,
        &[
            ("the probe, times of its reference", 2, Unit::Other, &|report| {
                Some(report.probe.as_ref()?.relative_time)
            }),
            ("seconds per frame, all work done", 3, Unit::Time, &|report| {
                Some(report.seconds_per_frame_settled)
            }),
            ("seconds per frame acknowledged", 3, Unit::Time, &|report| {
                Some(report.seconds_per_frame)
            }),
            // Other programs change it much less than they change the probe.
            ("processor time per frame, s", 3, Unit::Other, &|report| {
                report.processor_seconds_per_frame
            }),
        ],
    )
}

/// The stages that ran in any build.
fn stages(rounds: &[[Report; 2]]) -> Vec<Quantity> {
    let reports = rounds.iter().flatten();
    let names: BTreeSet<&String> = reports.flat_map(|report| report.stages.keys()).collect();
    let quantity = |name: &String| {
        let what = format!("{name}, ms per frame");
        let value = |report: &Report| {
            let stage = report.stages.get(name)?;
            Some(stage.seconds * 1e3 / report.frames.max(1) as f64)
        };
        Quantity::new(rounds, (&what, 2, Unit::Time, &value))
    };
    names.into_iter().map(quantity).collect()
}

fn cost(rounds: &[[Report; 2]]) -> Vec<Quantity> {
    listed(
        rounds,
        &[
            ("peak memory of the server, MiB", 0, Unit::Other, &|report| {
                Some(report.peak_rss_bytes? as f64 / MEBIBYTE)
            }),
            ("memory of the keyframes, MiB", 1, Unit::Other, &|report| {
                Some(report.keyframe_bytes as f64 / MEBIBYTE)
            }),
            ("Gaussians", 0, Unit::Other, &|report| Some(report.gaussians as f64)),
            ("keyframes", 0, Unit::Other, &|report| Some(report.keyframes as f64)),
        ],
    )
}

fn quality(rounds: &[[Report; 2]]) -> Vec<Quantity> {
    listed(
        rounds,
        &[
            ("frames tracked", 0, Unit::Other, &|report| Some(report.frames_tracked as f64)),
            ("ATE RMSE, cm", 4, Unit::Other, &|report| report.ate_rmse_cm),
            ("PSNR held out, dB", 3, Unit::Other, &|report| report.psnr_db),
            ("SSIM held out", 4, Unit::Other, &|report| report.ssim),
            ("LPIPS held out", 4, Unit::Other, &|report| report.lpips),
            ("depth L1 held out, m", 4, Unit::Other, &|report| report.depth_l1_m),
            ("PSNR keyframes, dB", 3, Unit::Other, &|report| report.keyframe_views.psnr_db),
            ("mIoU at 0.5", 4, Unit::Other, &|report| report.miou),
            ("mIoU at the bundle's threshold", 4, Unit::Other, &|report| {
                Some(report.language.as_ref()?.scene.masks?.miou_bundle)
            }),
            ("Loc, peak in a box", 4, Unit::Other, &|report| report.loc_accuracy),
            ("3D Chamfer over labels, m", 4, Unit::Other, &|report| report.chamfer_m),
            ("absent said rightly", 4, Unit::Other, &|report| report.absent_accuracy),
        ],
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::example::{example_probe, example_report};
    use crate::stages::Stage;

    /// A report whose machine and server take these multiples of the example's time.
    fn report(machine: f64, server: f64) -> Report {
        let example = example_report();
        let probe = example_probe();
        let stage = Stage { count: 40, seconds: 0.4 * server, mean_ms: 10.0 * server };
        Report {
            seconds_per_frame_settled: example.seconds_per_frame_settled * server,
            probe: Some(crate::probe::Probe { relative_time: machine, ..probe }),
            stages: [("decode".to_owned(), stage)].into(),
            ..example
        }
    }

    fn compared(rounds: &[[Report; 2]]) -> Comparison {
        Comparison::new(["new".into(), "old".into()], rounds)
    }

    fn found<'a>(comparison: &'a Comparison, what: &str) -> &'a Quantity {
        comparison.quantities.iter().find(|one| one.what == what).expect(what)
    }

    #[track_caller]
    fn assert_near(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }

    #[test]
    fn ratios_are_of_each_round_with_their_spread() {
        let rounds = [[report(1.0, 1.0), report(1.0, 2.0)], [report(1.0, 3.0), report(1.0, 24.0)]];
        let comparison = compared(&rounds);
        for what in ["seconds per frame, all work done", "decode, ms per frame"] {
            let ratio = found(&comparison, what).ratio.expect("both have it");
            assert_near(ratio.mean, 0.25);
            assert_near(ratio.lowest, 0.125);
            assert_near(ratio.highest, 0.5);
            assert_eq!(ratio.rounds, 2);
        }
        // The other way around it is the inverse, and of a build with itself it is 1.
        let swapped: Vec<_> = rounds.clone().map(|[a, b]| [b, a]).into();
        let ratio = found(&compared(&swapped), "decode, ms per frame").ratio.expect("both have it");
        assert_near(ratio.mean, 4.0);
        let same = compared(&[[rounds[0][0].clone(), rounds[0][0].clone()]]);
        for quantity in &same.quantities {
            assert_eq!(quantity.ratio.map(|ratio| (ratio.lowest, ratio.highest)), Some((1.0, 1.0)));
        }
    }

    #[test]
    fn a_slower_hour_is_scaled_away_and_a_slower_build_is_not() {
        let what = "seconds per frame, all work done";
        // The first build's turn had half of the machine.
        let busy = compared(&[[report(2.0, 2.0), report(1.0, 1.0)]]);
        assert_near(found(&busy, what).ratio.expect("a ratio").mean, 2.0);
        assert_near(found(&busy, what).scaled_ratio.expect("a ratio").mean, 1.0);
        assert_near(found(&busy, "decode, ms per frame").scaled_ratio.expect("a ratio").mean, 1.0);
        let slow = compared(&[[report(1.0, 2.0), report(1.0, 1.0)]]);
        assert_near(found(&slow, what).scaled_ratio.expect("a ratio").mean, 2.0);
        // Quality is no time, and processor time is not scaled.
        assert_eq!(found(&busy, "processor time per frame, s").scaled_ratio, None);
        assert_eq!(found(&busy, "PSNR held out, dB").scaled_ratio, None);
    }

    #[test]
    fn what_an_old_build_lacks_is_a_dash() {
        let old = Report {
            stages: [("other".to_owned(), Stage::default())].into(),
            peak_rss_bytes: None,
            probe: None,
            ..report(1.0, 1.0)
        };
        let comparison = compared(&[[report(1.0, 1.0), old]]);
        let rows = comparison.rows();
        let row = |what: &str| rows.iter().find(|row| row[0] == what).expect(what).join(" ");
        assert_eq!(row("decode, ms per frame"), "decode, ms per frame 10.00 - - - - -");
        assert_eq!(row("other, ms per frame"), "other, ms per frame - 0.00 - - - -");
        assert_eq!(
            row("peak memory of the server, MiB"),
            "peak memory of the server, MiB 512 - - - - -"
        );
        let speed = row("seconds per frame, all work done");
        assert!(speed.ends_with("0.275 0.275 1.000 1.000, 1.000 - -"), "{speed}");
        // What neither has is left out.
        let without = Report { psnr_db: None, ..report(1.0, 1.0) };
        let comparison = compared(&[[without.clone(), without]]);
        assert!(!comparison.quantities.iter().any(|one| one.what == "PSNR held out, dB"));
        assert!(rows.iter().any(|row| row[0] == "PSNR held out, dB"));
    }

    #[test]
    fn equal_values_have_a_ratio_of_one_and_zero_has_none_with_others() {
        let of = |this, that| Ratio::of([(this, that)].into_iter()).map(|ratio| ratio.mean);
        assert_eq!(of(Some(0.0), Some(0.0)), Some(1.0));
        assert_eq!(of(Some(f64::INFINITY), Some(f64::INFINITY)), Some(1.0));
        assert_eq!(of(Some(1.0), Some(0.0)), None);
        assert_eq!(of(Some(0.0), Some(1.0)), None);
        assert_eq!(of(Some(f64::NAN), Some(1.0)), None);
        assert_eq!(of(None, Some(1.0)), None);
        assert_eq!(of(Some(3.0), Some(2.0)), Some(1.5));
    }

    #[test]
    fn one_round_tells_nothing_and_each_further_one_halves_chance() {
        let rounds = |count: usize| vec![[report(1.0, 1.0), report(1.0, 1.0)]; count];
        assert_eq!([1, 2, 5].map(|count| compared(&rounds(count)).one_in()), [1, 2, 16]);
    }

    #[test]
    fn the_json_has_every_round() {
        let rounds = [[report(1.0, 1.0), report(1.0, 2.0)], [report(1.0, 1.0), report(1.0, 4.0)]];
        let json = serde_json::to_value(compared(&rounds)).expect("it is plain");
        assert_eq!((&json["this"], &json["rounds"]), (&"new".into(), &2.into()));
        let list = json["quantities"].as_array().expect("a list");
        let decode = list.iter().find(|one| one["what"] == "decode, ms per frame").expect("it ran");
        assert_eq!(decode["that"], serde_json::json!([20.0, 40.0]));
        assert_eq!(decode["ratio"]["lowest"], 0.25);
    }
}
