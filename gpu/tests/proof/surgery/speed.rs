//! Time of surgery, for a person to read:
//! `cargo test -p lexsplat-gpu surgery::speed -- --ignored --nocapture`.

use super::map;
use crate::support;

use std::time::{Duration, Instant};

use lexsplat_gpu::{Buffer, DensifyRules, Gaussians, Gpu, HostGaussians, Statistics};
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
        // Compiles the kernels.
        map.retain_flagged(&Buffer::from_slice(gpu, "none", &[0, 0]).expect("fits")).expect("fits");
        map.append(host).expect("fits");
        let seen = |i: usize| Statistics {
            gradient_sum: if i.is_multiple_of(10) { 1.0 } else { 0.0 },
            views: 1.0,
            largest_radius: if i % 10 == 3 { 99.0 } else { 1.0 },
            ..Statistics::default()
        };
        map.set_statistics(&(0..host.len()).map(seen).collect::<Vec<_>>()).expect("one each");
        wait(gpu);
        let time = Instant::now();
        run(&mut map);
        wait(gpu);
        best = best.min(time.elapsed());
    }
    println!("{} {name}: {best:.1?}", host.len());
}

#[test]
#[ignore = "a measurement, not a test"]
fn time_of_surgery() {
    let gpu = support::gpu();
    println!("adapter {}", gpu.adapter_name());
    let mut first = map(&gpu, &support::scene(1, 2, 16, 0.01));
    let time = Instant::now();
    first.retain(&[true, false]).expect("fits");
    wait(&gpu);
    println!("first surgery, which compiles the kernels: {:.1?}", time.elapsed());
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
            map.densify(&rules).expect("fits");
        });
        let rules = DensifyRules { max_gaussians: 2 * count, max_radius: None, ..rules };
        measure(&gpu, &host, "densify with growth, 10 % born", &mut |map| {
            map.densify(&rules).expect("fits");
        });
        measure(&gpu, &host, "morton", &mut |map| map.reorder_morton().expect("fits"));
    }
}
