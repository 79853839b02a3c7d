//! Prints the time to prune and to reorder maps:
//! `cargo test -p lexsplat-gpu map::speed -- --ignored --nocapture`.

use super::{MIN_OPACITY, map, mark};
use crate::support;

use std::time::{Duration, Instant};

use lexsplat_gpu::{Buffer, Gaussians, Gpu, HostGaussians};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

/// Waits for all that was submitted.
fn wait(gpu: &Gpu) {
    Buffer::<u32>::new(gpu, "wait", 1).expect("fits").read(gpu, 1).expect("reads");
}

/// Best of three runs on fresh maps.
fn measure(gpu: &Gpu, host: &HostGaussians, name: &str, run: &mut dyn FnMut(&mut Gaussians)) {
    let mut best = Duration::MAX;
    for _ in 0..3 {
        let mut map = map(gpu, &support::scene(1, 2, 16, 0.01));
        map.prune(0.0).expect("compiles the kernels");
        map.append(host).expect("fits");
        wait(gpu);
        let time = Instant::now();
        run(&mut map);
        wait(gpu);
        best = best.min(time.elapsed());
    }
    println!("{} {name}: {best:.1?}", host.len());
}

#[test]
#[ignore = "a measurement, not a test: make bench"]
fn time_to_rearrange() {
    let gpu = support::gpu();
    println!("adapter {}", gpu.adapter_name());
    let mut first = map(&gpu, &support::scene(1, 2, 16, 0.01));
    let time = Instant::now();
    first.prune(MIN_OPACITY).expect("fits");
    wait(&gpu);
    println!("first time, which compiles the kernels: {:.1?}", time.elapsed());
    for count in [100_000, 500_000] {
        let mut host = support::scene(1, count, 16, 0.01);
        host.means.shuffle(&mut ChaCha8Rng::seed_from_u64(1));
        let bytes = map(&gpu, &host).device_bytes() / count as u64;
        println!("{count} gaussians: {bytes} bytes each");
        let keep: Vec<bool> = (0..count).map(|i| i % 10 != 3).collect();
        let host = mark(&host, &keep);
        measure(&gpu, &host, "prune 10 %", &mut |map| {
            map.prune(MIN_OPACITY).expect("fits");
        });
        measure(&gpu, &host, "morton", &mut |map| map.reorder_morton().expect("fits"));
    }
}
