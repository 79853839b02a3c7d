//! Pictures and training steps, by size of the picture, of the map and of the codes.

use std::time::{Duration, Instant};

use lexsplat_gpu::{
    ColorTarget, Gaussians, Gpu, GpuError, KernelTime, LanguageTarget, LearningRates, LossWeights,
    Trainer, TrainingView,
};

use crate::{best, ms, scene};

/// Steps between two looks at the clock.
const STEPS: u32 = 3;
/// Length of a code.
const CHANNELS: usize = 15;

/// Which kernels make up a stage.
const STAGES: [(&str, &[&str]); 7] = [
    ("project", &["project_"]),
    ("lists", &["order_", "sort_", "scan_", "tiles_"]),
    ("blend", &["blend_color", "blend_language"]),
    ("loss", &["loss_", "reduce"]),
    ("blend back", &["blend_back_"]),
    ("to params", &["collect_", "project_back_"]),
    ("adam", &["adam_", "ties_"]),
];

/// A map and something to learn from.
struct Bench {
    gaussians: Gaussians,
    trainer: Trainer,
    camera: lexsplat_gpu::Camera,
    labels: lexsplat_gpu::Camera,
    color: ColorTarget,
    language: LanguageTarget,
}

impl Bench {
    fn new(
        gpu: &Gpu,
        (width, height): (u32, u32),
        n: usize,
        codes: usize,
    ) -> Result<Self, GpuError> {
        let camera = scene::camera(width, height);
        let labels = camera.resized(width / 4, height / 4);
        let mut gaussians = Gaussians::new(gpu, codes);
        gaussians.append(&scene::scene(n, codes))?;
        let pixels = camera.pixels();
        let rgb = vec![127; 3 * pixels];
        let target = vec![0.5; codes * labels.pixels()];
        Ok(Self {
            gaussians,
            trainer: Trainer::new(gpu, codes)?,
            color: ColorTarget::new(gpu, width, height, &rgb, &vec![2.5; pixels])?,
            language: LanguageTarget::new(gpu, labels.width, labels.height, codes, &target)?,
            camera,
            labels,
        })
    }

    fn draw(&mut self) -> Result<(), GpuError> {
        self.trainer.renderer().draw_color(&self.gaussians, &self.camera).map(drop)
    }

    fn draw_language(&mut self) -> Result<(), GpuError> {
        self.trainer.renderer().render_language(&self.gaussians, &self.labels).map(drop)
    }

    /// Takes [`STEPS`] steps and returns the shortest time that one took on the host.
    fn steps(&mut self, color: bool, language: bool) -> Result<Duration, GpuError> {
        let (weights, rates) = (LossWeights::default(), LearningRates::default());
        let view = TrainingView {
            camera: &self.camera,
            color: color.then_some(&self.color),
            language: language.then_some((&self.labels, &self.language)),
            exposure: [0.0; 2],
            focus: None,
        };
        let mut host = Duration::MAX;
        for step in 0..STEPS {
            let start = Instant::now();
            self.trainer.step(&mut self.gaussians, &view, &weights, &rates)?;
            if step < 2 {
                host = host.min(start.elapsed());
            }
        }
        self.trainer.settle(&mut self.gaussians)?;
        Ok(host)
    }
}

/// A table by size of picture and map; `ceiling` in evaluations per second.
pub fn by_view(gpu: &Gpu, ceiling: f64) -> Result<(), GpuError> {
    for size in [(600, 340), (1200, 680)] {
        println!("\n{} x {}, codes of {CHANNELS} at a quarter of the size; ms", size.0, size.1);
        println!(
            "{:>9} {:>8} {:>9} {:>7} {:>8} {:>6} {:>8} {:>6} {:>8} {:>8} {:>6} {:>8}",
            "Gaussians",
            "visible",
            "hits",
            "G eval",
            "forward",
            "G/s",
            "ceiling",
            "lists",
            "backward",
            "language",
            "host",
            "B/Gauss."
        );
        for n in [20_000, 100_000, 500_000, 2_000_000] {
            if let Err(error) = view(gpu, size, n, ceiling) {
                println!("{n:>9} {error}");
            }
        }
    }
    Ok(())
}

fn view(gpu: &Gpu, size: (u32, u32), n: usize, ceiling: f64) -> Result<(), GpuError> {
    let mut bench = Bench::new(gpu, size, n, CHANNELS)?;
    let work = bench.trainer.renderer().workload(&bench.gaussians, &bench.camera)?;
    let forward = best(5, || bench.draw())?;
    gpu.start_profile();
    bench.draw()?;
    let profile = gpu.take_profile()?;
    let lists = stage(&profile, 1) / total(&profile);
    let rate = work.evaluations as f64 / forward.as_secs_f64();
    print!(
        "{n:>9} {:>8} {:>9} {:>7.3} {:>8.1} {:>6.2} {:>7.0}% {:>5.0}%",
        work.visible,
        work.hits,
        work.evaluations as f64 / 1e9,
        ms(forward),
        rate / 1e9,
        100.0 * rate / ceiling,
        100.0 * lists
    );
    let mut host = Duration::MAX;
    let color = best(4, || bench.steps(true, false).map(|time| host = host.min(time)))?;
    let both = best(4, || bench.steps(true, true).map(drop))?;
    let backward = color.as_secs_f64() / f64::from(STEPS) - forward.as_secs_f64();
    let bytes = bench.gaussians.device_bytes() + bench.trainer.renderer().device_bytes();
    println!(
        " {:>8.1} {:>8.1} {:>6.2} {:>8}",
        backward * 1e3,
        (ms(both) - ms(color)) / f64::from(STEPS),
        ms(host),
        bytes / n as u64
    );
    gpu.start_profile();
    bench.steps(true, true)?;
    let profile = gpu.take_profile()?;
    let shares: Vec<String> = STAGES
        .iter()
        .enumerate()
        .map(|(at, (name, _))| format!("{name} {:.1}", stage(&profile, at) / f64::from(STEPS)))
        .collect();
    println!("{:>9} {}", "", shares.join(", "));
    Ok(())
}

/// Milliseconds of a stage.
fn stage(profile: &[KernelTime], at: usize) -> f64 {
    let of = |label: &str| {
        let longest = |prefixes: &[&str]| {
            prefixes.iter().filter(|p| label.starts_with(**p)).map(|p| p.len()).max()
        };
        let found = STAGES.iter().enumerate().filter_map(|(i, (_, p))| Some((longest(p)?, i)));
        found.max().map(|(_, stage)| stage)
    };
    profile.iter().filter(|kernel| of(kernel.label) == Some(at)).map(|kernel| ms(kernel.time)).sum()
}

fn total(profile: &[KernelTime]) -> f64 {
    profile.iter().map(|kernel| ms(kernel.time)).sum()
}

/// A table by length of the code.
pub fn by_channels(gpu: &Gpu) -> Result<(), GpuError> {
    let (size, n) = ((600, 340), 100_000);
    println!("\n{} x {}, {n} Gaussians, by length of the code at full size; ms", size.0, size.1);
    println!("{:>9} {:>9} {:>9} {:>9}", "channels", "forward", "of color", "step");
    for codes in [3, 8, 15, 32, 64] {
        let mut bench = Bench::new(gpu, size, n, codes)?;
        let color = best(3, || bench.draw())?;
        bench.labels = bench.camera.clone();
        let target = vec![0.5; codes * bench.labels.pixels()];
        bench.language = LanguageTarget::new(gpu, size.0, size.1, codes, &target)?;
        let picture = best(3, || bench.draw_language())?;
        let step = best(2, || bench.steps(false, true).map(drop))?;
        println!(
            "{codes:>9} {:>9.1} {:>9.2} {:>9.1}",
            ms(picture),
            picture.as_secs_f64() / color.as_secs_f64(),
            ms(step) / f64::from(STEPS)
        );
    }
    Ok(())
}
