//! Time and memory of surgery, for a person to read:
//! `cargo test -p lexsplat-gpu surgery::speed -- --ignored --nocapture`. The software adapter's
//! device memory is the process's own, so its peak is what the kernel says of the process.

use super::map;
use crate::support;

use std::time::Instant;

use lexsplat_gpu::buffer::Buffer;
use lexsplat_gpu::{DensifyRules, Gaussians, Gpu, HostGaussians, Statistics};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

const MEBIBYTE: f64 = 1024.0 * 1024.0;

/// Waits for all that was submitted.
fn wait(gpu: &Gpu) {
    Buffer::<u32>::new(gpu, "wait", 1).expect("fits").read(gpu, 1).expect("reads");
}

/// A line of `/proc/self/status`, in bytes.
fn status(name: &str) -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").expect("there is a status");
    let line = text.lines().find(|line| line.starts_with(name)).expect("it has this line");
    let kibibytes = line.split_whitespace().nth(1).expect("it has a value");
    kibibytes.parse::<f64>().expect("a number") * 1024.0
}

/// Runs an operation on fresh maps: best time, and the peak of memory above what was there before.
fn measure(gpu: &Gpu, host: &HostGaussians, name: &str, run: &mut dyn FnMut(&mut Gaussians)) {
    let mut best = f64::INFINITY;
    let mut peak = 0.0f64;
    let mut share = 0.0;
    for _ in 0..3 {
        let mut map = map(gpu, host);
        let seen = |i: usize| Statistics {
            gradient_sum: if i.is_multiple_of(10) { 1.0 } else { 0.0 },
            views: 1.0,
            largest_radius: if i % 10 == 3 { 99.0 } else { 1.0 },
            ..Statistics::default()
        };
        map.set_statistics(&(0..host.len()).map(seen).collect::<Vec<_>>()).expect("one each");
        // Compiles the kernels.
        map.retain_flagged(&Buffer::from_slice(gpu, "all", &vec![1; host.len()]).expect("fits"))
            .expect("fits");
        wait(gpu);
        // Five sets the peak to what is there now.
        std::fs::write("/proc/self/clear_refs", "5").expect("the peak can be reset");
        let before = status("VmRSS");
        let time = Instant::now();
        run(&mut map);
        wait(gpu);
        best = best.min(time.elapsed().as_secs_f64());
        peak = peak.max(status("VmHWM") - before);
        share = peak / map.device_bytes() as f64;
    }
    println!(
        "{} {name}: {:.1} ms, peak {:.1} MiB above, {:.0} % of the map",
        host.len(),
        1e3 * best,
        peak / MEBIBYTE,
        100.0 * share,
    );
}

#[test]
#[ignore = "a measurement, not a test"]
fn time_and_memory_of_surgery() {
    let gpu = support::gpu();
    println!("adapter {}", gpu.adapter_name());
    for count in [100_000, 500_000] {
        let mut host = support::scene(1, count, 16, 0.01);
        host.means.shuffle(&mut ChaCha8Rng::seed_from_u64(1));
        let bytes = map(&gpu, &host).device_bytes() / count as u64;
        println!("{count} gaussians: {bytes} bytes each");
        let keep: Vec<bool> = (0..count).map(|i| i % 10 != 3).collect();
        let flags: Vec<u32> = keep.iter().map(|keep| u32::from(*keep)).collect();
        let flags = Buffer::from_slice(&gpu, "flags", &flags).expect("fits");
        measure(&gpu, &host, "retain", &mut |map| map.retain(&keep).expect("fits"));
        measure(&gpu, &host, "retain by device flags", &mut |map| {
            map.retain_flagged(&flags).expect("fits");
        });
        let rules = DensifyRules {
            min_gradient: 0.5,
            clone_scale: 0.01,
            min_opacity: 0.0,
            max_scale: None,
            either_head: false,
            max_radius: Some(50.0),
            max_gaussians: count,
            seed: 1,
        };
        measure(&gpu, &host, "densify, 10 % pruned, 10 % born", &mut |map| {
            let counts = map.densify(&rules).expect("fits");
            assert_eq!(counts.len, count);
        });
        let rules = DensifyRules { max_gaussians: 2 * count, max_radius: None, ..rules };
        measure(&gpu, &host, "densify with growth, 10 % born", &mut |map| {
            map.densify(&rules).expect("fits");
        });
        measure(&gpu, &host, "morton", &mut |map| map.reorder_morton().expect("fits"));
    }
}
