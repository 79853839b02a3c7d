//! How long the splatting pass takes, stage by stage, and how far that is from what the adapter can
//! do at all: `cargo bench -p lexsplat-gpu`, or `... -- SECTION` with one of `views`, `channels`,
//! `primitives`, `tracking`. Times are the best of several runs; ratios are within one run.
//!
//! `exchange` runs only where `EXCHANGE=FOLDER` is set; `EXCHANGE_SCENE=COUNT,WIDTH,HEIGHT` is the
//! scene.

mod ceiling;
mod exchange;
mod primitives;
mod scene;
mod tracking;
mod views;

use std::time::{Duration, Instant};

use lexsplat_gpu::shader::Tiling;
use lexsplat_gpu::{Gpu, GpuError};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let sections: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let wanted = |name: &str| sections.is_empty() || sections.iter().any(|s| s == name);
    let gpu = Gpu::new(None)?;
    println!("adapter {}, tier {}", gpu.adapter_name(), gpu.tier().name());
    let ceiling = ceiling::rate(&gpu)?;
    println!(
        "ceiling: {:.2} G evaluations/s, tiles of {:?} pixels",
        ceiling / 1e9,
        Tiling::of(gpu.tier()).size()
    );
    if wanted("views") {
        views::by_view(&gpu, ceiling)?;
    }
    if wanted("channels") {
        views::by_channels(&gpu)?;
    }
    if wanted("primitives") {
        primitives::print(&gpu)?;
    }
    if wanted("tracking") {
        tracking::print(&gpu)?;
    }
    if let (true, Ok(folder)) = (wanted("exchange"), std::env::var("EXCHANGE")) {
        let scene =
            std::env::var("EXCHANGE_SCENE").unwrap_or_else(|_| "500000,1200,680".to_owned());
        let numbers: Vec<u32> = scene.split(',').map(str::parse).collect::<Result<_, _>>()?;
        let [count, width, height] = numbers[..] else {
            return Err("EXCHANGE_SCENE must be COUNT,WIDTH,HEIGHT".into());
        };
        exchange::print(&gpu, folder.as_ref(), count as usize, (width, height))?;
    }
    Ok(())
}

/// The best of several runs, after one that warms up.
fn best(runs: usize, mut run: impl FnMut() -> Result<(), GpuError>) -> Result<Duration, GpuError> {
    run()?;
    let mut best = Duration::MAX;
    for _ in 0..runs {
        let start = Instant::now();
        run()?;
        best = best.min(start.elapsed());
    }
    Ok(best)
}

/// Milliseconds.
fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
