//! Timings, for a person to read: `cargo test -p lexsplat-gpu speed -- --ignored --nocapture`.

use crate::support;

use std::time::Instant;

use lexsplat_gpu::{
    ColourTarget, Gaussians, LanguageTarget, LearningRates, LossWeights, Renderer, TrainingView,
};

#[test]
#[ignore = "a measurement, not a test"]
fn time_of_forward_and_step() {
    let gpu = support::gpu();
    println!("adapter {}", gpu.adapter_name());
    let channels = 15;
    let mut renderer = Renderer::new(&gpu, channels).expect("kernels compile");
    for (width, height) in [(320, 240), (600, 340)] {
        for count in [10_000, 30_000, 50_000] {
            let camera = support::camera(width, height);
            let labels = camera.resized(width / 4, height / 4);
            let mut gaussians = Gaussians::new(&gpu, channels);
            let size = 1.5 / (count as f32).sqrt();
            gaussians.append(&support::scene(1, count, channels, size)).expect("fits");
            let pixels = camera.pixels();
            let rgb = vec![127; 3 * pixels];
            let target =
                ColourTarget::new(&gpu, (width, height), &rgb, &vec![2.0; pixels]).expect("fits");
            let codes = vec![0.5; channels * labels.pixels()];
            let language = LanguageTarget::new(&gpu, labels.width, labels.height, channels, &codes)
                .expect("fits");
            let best = |run: &mut dyn FnMut()| {
                run();
                (0..5)
                    .map(|_| {
                        let t = Instant::now();
                        run();
                        t.elapsed()
                    })
                    .min()
                    .expect("five")
            };
            let colour = best(&mut || {
                renderer.render_colour(&gaussians, &camera).expect("renders");
            });
            let code = best(&mut || {
                renderer.render_language(&gaussians, &labels).expect("renders");
            });
            let (weights, rates) = (LossWeights::default(), LearningRates::default());
            let mut step = |colour, language| {
                let view = TrainingView { camera: &camera, colour, language, exposure: [0.0; 2] };
                best(&mut || {
                    for _ in 0..4 {
                        renderer.step(&mut gaussians, &view, &weights, &rates).expect("steps");
                    }
                    renderer.settle(&mut gaussians).expect("settles");
                }) / 4
            };
            let colour_step = step(Some(&target), None);
            let full_step = step(Some(&target), Some((&labels, &language)));
            println!(
                "{width}x{height} {count}: colour {colour:.1?}, language 1/4 {code:.1?}, \
                 step colour {colour_step:.1?}, step both {full_step:.1?}"
            );
        }
    }
}
