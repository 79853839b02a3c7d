//! Timings of pyramids and alignment, for a person to read:
//! `cargo test -p lexsplat-gpu align_speed -- --ignored --nocapture`.

use std::time::{Duration, Instant};

use crate::room::{Bench, camera, motion, shoot, spoil};

use lexsplat_gpu::{AlignSettings, Estimate, Schedule};
use nalgebra::Isometry3;

#[test]
#[ignore = "a measurement, not a test: make bench"]
fn time_of_pyramid_and_alignment() {
    let mut bench = Bench::new();
    let camera = camera(600, 340);
    let mut frame = shoot(&camera, &Isometry3::identity(), [0.0; 2]);
    spoil(&mut frame, 3, 0.0);
    let mut pyramid = bench.pyramid(&camera, &frame, 3);
    let taken = time(&mut || {
        bench.pyramids.fill(&mut pyramid, &frame.rgb, &frame.depth).expect("fits");
        pyramid.levels()[2].surface.read(&bench.gpu, 1).expect("reads");
    });
    println!("pyramid of 3 levels from 600x340: {taken}");
    let taken = time(&mut || {
        pyramid.levels()[2].surface.read(&bench.gpu, 1).expect("reads");
    });
    println!("read-back alone: {taken}");
    let (reference, live) = bench.pair((600, 340), 3, 0.0);
    for level in 0..3 {
        for stride in [1, 4, 16] {
            let levels = (&reference.levels()[level], &live.levels()[level]);
            let settings = AlignSettings { stride, ..AlignSettings::default() };
            let mut run = || {
                bench.aligner.system(levels.0, levels.1, &motion(), &settings).expect("sums");
            };
            let taken = time(&mut run);
            println!("system at level {level}, stride {stride}: {taken}");
        }
    }
    let mut systems = 0;
    let taken = time(&mut || {
        let found = bench
            .aligner
            .align(&reference, &live, &Estimate::default(), &Schedule::default())
            .expect("sums");
        systems = found.evaluations;
    });
    println!("align over 3 levels, {systems} systems: {taken}");
}

/// Processor time of the process, milliseconds.
fn processor_ms() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").expect("Linux");
    let fields: Vec<&str> = text.split_whitespace().collect();
    10.0 * (fields[13].parse::<f64>().expect("a number")
        + fields[14].parse::<f64>().expect("a number"))
}

/// Median and best of 40 after a warm-up, and processor time.
fn time(run: &mut dyn FnMut()) -> String {
    run();
    let before = processor_ms();
    let mut times: Vec<Duration> = (0..40)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed()
        })
        .collect();
    let cpu = (processor_ms() - before) / 40.0;
    times.sort();
    format!("median {:.2?}, best {:.2?}, processor {cpu:.2} ms", times[20], times[0])
}
