//! **The probe**: a fixed piece of work that is timed before and after a run, so that times of
//! different hours and machines can be compared. It runs in the evaluating program and not in the
//! server, so that it is the same for every build of the server.
//!
//! In: nothing. Out: milliseconds of three parts, and `relative_time`, how long they take relative to
//! the [`REFERENCE`]. It takes half a second on an idle machine of two cores, and less than two
//! seconds on one that is busy. It says nothing about a GPU.

mod work;

use crate::statistics::geometric_mean;
use serde::Serialize;
use std::time::{Duration, Instant};
use work::{Blend, Product, Sweep};

/// Most repetitions of a part; there are fewer if they take longer than [`PART_LIMIT`].
const REPETITIONS: usize = 15;
const LEAST_REPETITIONS: usize = 3;
const PART_LIMIT: Duration = Duration::from_millis(400);

/// The machine that others are compared with, and the fastest repetitions on it: what the parts take
/// when nothing else runs.
pub const REFERENCE: Reference = Reference {
    name: "two cores of an AMD EPYC with AVX-512, 29 Nov 2026",
    memory_ms: 12.0,
    blend_ms: 7.0,
    product_ms: 18.0,
};

/// Times of the probe on a named machine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Reference {
    /// What machine it is, and when it was measured.
    pub name: &'static str,
    /// 64 MiB copied four times, milliseconds.
    pub memory_ms: f64,
    /// The blend, milliseconds.
    pub blend_ms: f64,
    /// The matrix product, milliseconds.
    pub product_ms: f64,
}

/// The repetitions of a part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Repeated {
    /// The fastest, milliseconds.
    pub min_ms: f64,
    /// The median, milliseconds. Other programs make it larger.
    pub median_ms: f64,
    /// How many there were.
    pub repetitions: usize,
}

/// The probe at one time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProbeTimes {
    /// 64 MiB copied four times, by all cores.
    pub memory: Repeated,
    /// Gaussians blended at 24,576 pixels, by all cores.
    pub blend: Repeated,
    /// Two matrices of 1536x1536 multiplied by ONNX Runtime; null if it cannot be loaded.
    pub product: Option<Repeated>,
    /// Why there is no product.
    pub without_product: Option<String>,
}

/// The probe before and after a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Probe {
    /// Before the first frame.
    pub before: ProbeTimes,
    /// After the last question.
    pub after: ProbeTimes,
    /// Cores that it used.
    pub cores: usize,
    /// The machine that `relative_time` is relative to.
    pub reference: Reference,
    /// Time of the probe, in times of the reference: the geometric mean over parts, and over before
    /// and after, of medians. 2: everything took twice as long, on a slower machine or a busy one.
    pub relative_time: f64,
    /// Time after the run, in times before it, the geometric mean over parts. Far from 1, the load
    /// of the machine has changed.
    pub change: f64,
}

impl Probe {
    /// The probe of a run.
    pub fn new(before: ProbeTimes, after: ProbeTimes) -> Self {
        let [earlier, later] = [&before, &after].map(medians_over_reference);
        let parts = || earlier.iter().zip(&later).filter_map(|(a, b)| (*a).zip(*b));
        let mean = |of: Vec<f64>| geometric_mean(of.into_iter()).expect("every probe has a copy");
        Self {
            relative_time: mean(parts().flat_map(|(before, after)| [before, after]).collect()),
            change: mean(parts().map(|(before, after)| after / before).collect()),
            cores: rayon::current_num_threads(),
            reference: REFERENCE,
            before,
            after,
        }
    }
}

/// Runs the probe on this machine. It blocks.
pub fn measure() -> ProbeTimes {
    let mut sweep = Sweep::new();
    let memory = repeated(|| sweep.run());
    drop(sweep);
    let blend = Blend::new(1);
    let blend = repeated(|| {
        blend.run();
    });
    let product = product();
    let without_product = product.as_ref().err().cloned();
    ProbeTimes { memory, blend, product: product.ok(), without_product }
}

fn product() -> Result<Repeated, String> {
    let mut product = Product::open()?;
    product.run()?;
    Ok(repeated(|| {
        product.run().expect("what ran once runs again");
    }))
}

/// Times of a piece of work; its first run is not counted, since it fills the caches.
fn repeated(mut work: impl FnMut()) -> Repeated {
    work();
    let started = Instant::now();
    let mut times = Vec::with_capacity(REPETITIONS);
    while times.len() < LEAST_REPETITIONS
        || times.len() < REPETITIONS && started.elapsed() < PART_LIMIT
    {
        let began = Instant::now();
        work();
        times.push(began.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    let (min_ms, median_ms) = (times[0], times[times.len() / 2]);
    Repeated { min_ms, median_ms, repetitions: times.len() }
}

fn medians_over_reference(times: &ProbeTimes) -> [Option<f64>; 3] {
    let over = |part: Repeated, reference_ms: f64| part.median_ms / reference_ms;
    [
        Some(over(times.memory, REFERENCE.memory_ms)),
        Some(over(times.blend, REFERENCE.blend_ms)),
        times.product.map(|product| over(product, REFERENCE.product_ms)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A probe whose parts take these multiples of the reference.
    fn times(memory: f64, blend: f64, product: Option<f64>) -> ProbeTimes {
        let part = |ms: f64| Repeated { min_ms: ms / 2.0, median_ms: ms, repetitions: 9 };
        ProbeTimes {
            memory: part(memory * REFERENCE.memory_ms),
            blend: part(blend * REFERENCE.blend_ms),
            product: product.map(|product| part(product * REFERENCE.product_ms)),
            without_product: None,
        }
    }

    #[track_caller]
    fn assert_near(found: f64, expected: f64) {
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }

    #[test]
    fn the_reference_has_a_relative_time_of_one() {
        let probe = Probe::new(times(1.0, 1.0, Some(1.0)), times(1.0, 1.0, Some(1.0)));
        assert_near(probe.relative_time, 1.0);
        assert_near(probe.change, 1.0);
    }

    #[test]
    fn parts_count_alike_and_a_change_of_load_shows() {
        let probe = Probe::new(times(1.0, 2.0, Some(4.0)), times(2.0, 4.0, Some(8.0)));
        // The cube root of 8, and half a doubling.
        assert_near(probe.relative_time, 2.0 * 2.0_f64.sqrt());
        assert_near(probe.change, 2.0);
        // A part that one of both lacks does not count.
        let without = Probe::new(times(1.0, 4.0, None), times(1.0, 4.0, Some(100.0)));
        assert_near(without.relative_time, 2.0);
        assert_near(without.change, 1.0);
    }

    #[test]
    fn the_probe_runs_on_this_machine() {
        let probe = Probe::new(measure(), measure());
        println!("{probe:?}");
        assert!(probe.relative_time.is_finite() && probe.relative_time > 0.0, "{probe:?}");
        for part in [Some(probe.before.memory), Some(probe.after.blend), probe.after.product] {
            let part = part.expect("`make deps` was run");
            assert!(part.min_ms > 0.0 && part.min_ms <= part.median_ms, "{probe:?}");
            assert!((LEAST_REPETITIONS..=REPETITIONS).contains(&part.repetitions), "{probe:?}");
        }
    }

    #[test]
    fn repetitions_are_bounded_and_the_first_is_not_counted() {
        let mut runs = 0;
        let quick = repeated(|| runs += 1);
        assert_eq!((quick.repetitions, runs), (REPETITIONS, REPETITIONS + 1));
        let slow = repeated(|| std::thread::sleep(PART_LIMIT));
        assert_eq!(slow.repetitions, LEAST_REPETITIONS);
        assert!(slow.min_ms >= PART_LIMIT.as_secs_f64() * 1e3);
    }
}
