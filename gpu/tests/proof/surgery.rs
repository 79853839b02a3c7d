//! baseline
use crate::support;
use lexsplat_gpu::Gaussians;
use std::time::Instant;
#[test]
#[ignore = "a measurement, not a test"]
fn baseline_retain() {
    let gpu = support::gpu();
    for count in [100_000, 500_000] {
        let scene = support::scene(1, count, 16, 0.01);
        let keep: Vec<bool> = (0..count).map(|i| i % 10 != 3).collect();
        for _ in 0..3 {
            let mut map = Gaussians::new(&gpu, 16);
            let t = Instant::now();
            map.append(&scene).expect("fits");
            map.retain(&vec![true; count]).expect("");
            let a = t.elapsed();
            let one = (0..1000).collect::<Vec<u32>>();
            let _ = lexsplat_gpu::buffer::Buffer::from_slice(&gpu, "x", &one)
                .unwrap()
                .read(&gpu, 1)
                .unwrap();
            let t = Instant::now();
            map.retain(&keep).expect("fits");
            let _ = lexsplat_gpu::buffer::Buffer::from_slice(&gpu, "x", &one)
                .unwrap()
                .read(&gpu, 1)
                .unwrap();
            println!(
                "{count}: append {a:.1?} retain {:.1?} bytes {}",
                t.elapsed(),
                map.device_bytes()
            );
        }
    }
}
