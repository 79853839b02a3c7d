//! Quality of decoded codes while the online stage learns, and the duration of learning.
//!
//! In: the images of a sequence, in order; each is a keyframe. Out: rows of CSV (scene, stage,
//! keyframe, first_carried, first_frozen, all_carried, all_frozen, milliseconds). The quality is
//! the mean cosine between generic codes and the codes that their online codes decode to, for the
//! first keyframe and for all so far. "Carried" codes are converted at each new version, as the
//! server does; "frozen" codes are encoded once. Milliseconds: learning from that keyframe.
//! Standard output has the median durations of encoding an image and of learning. `plot-codes` of
//! `training/` draws the CSV.
//!
//! ```sh
//! cargo run --release -p lexsplat-server --example codes_over_time -- \
//!     --scene kitchen --csv codes.csv kitchen/*.jpg
//! ```

use anyhow::Context as _;
use clap::Parser;
use lexsplat_server::pipeline::compressor::{
    CompressorConfig, GENERIC_SIZE, OnlineStage, Stage, carry_over, online,
};
use lexsplat_server::pipeline::encoder::{LanguageConfig, Vision};
use lexsplat_server::pipeline::frame::{Frame, FrameUp, Intrinsics};
use lexsplat_server::pipeline::network::Bundle;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Codes measured of each keyframe, evenly spread.
const MEASURED: usize = 200;

/// Quality of decoded codes while the online stage learns.
#[derive(Parser)]
struct Arguments {
    /// Name of the sequence in the CSV.
    #[arg(long)]
    scene: String,
    /// File to which rows are appended.
    #[arg(long)]
    csv: PathBuf,
    /// Folder of the bundle of networks.
    #[arg(long, default_value = "models/tiny")]
    models: PathBuf,
    /// JPEG or PNG images, in order.
    #[arg(required = true)]
    images: Vec<PathBuf>,
}

fn frame(path: &Path) -> anyhow::Result<Frame> {
    let image = image::open(path).with_context(|| path.display().to_string())?.into_rgb8();
    let (width, height) = image.dimensions();
    Ok(Frame {
        sequence: 0,
        timestamp_nanos: 0,
        intrinsics: Intrinsics { width, height, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 },
        depth_metres: vec![0.0; (width * height) as usize].into(),
        rgb: image.into_raw().into(),
        depth_lag_nanos: 0,
        world_from_camera: None,
        hint: None,
        labels: None,
        held_out: false,
        up: FrameUp::default(),
    })
}

/// Codes of one keyframe: generic codes, converted online codes, and online codes as first encoded.
struct MeasuredCodes {
    truth: Vec<f32>,
    carried: Vec<f32>,
    frozen: Vec<f32>,
}

fn cosine(stage: &dyn OnlineStage, codes: &[f32], truth: &[f32]) -> f32 {
    let decoded = stage.decode(codes);
    let products = decoded.iter().zip(truth).map(|(a, b)| a * b);
    products.sum::<f32>() * GENERIC_SIZE as f32 / truth.len() as f32
}

fn mean(values: impl ExactSizeIterator<Item = f32>) -> f32 {
    let count = values.len() as f32;
    values.sum::<f32>() / count
}

/// Median of all but the first, which is a warm-up.
fn median(mut times: Vec<f32>) -> f32 {
    times.remove(0);
    times.sort_by(f32::total_cmp);
    times.get(times.len() / 2).copied().unwrap_or_default()
}

fn sampled(codes: &[f32]) -> Vec<f32> {
    let stride = (codes.len() / GENERIC_SIZE / MEASURED).max(1);
    codes.chunks_exact(GENERIC_SIZE).step_by(stride).flatten().copied().collect()
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let config = LanguageConfig { models: arguments.models, ..LanguageConfig::default() };
    let mut vision = Vision::new(
        Bundle::load(&config)?.split().0,
        Box::new(|_| Err("frames have no labels".into())),
        &config,
    );
    let (mut codes, mut times) = (Vec::new(), Vec::new());
    for path in &arguments.images {
        let frame = frame(path)?;
        let started = Instant::now();
        codes.push(vision.run(&frame)?.codes);
        times.push(started.elapsed().as_secs_f32() * 1e3);
    }
    println!("{}: {:.1} ms from an image to codes (median)", arguments.scene, median(times));
    let is_new = !arguments.csv.exists();
    let mut csv = std::fs::OpenOptions::new().create(true).append(true).open(&arguments.csv)?;
    if is_new {
        writeln!(
            csv,
            "scene,stage,keyframe,first_carried,first_frozen,all_carried,all_frozen,milliseconds"
        )?;
    }
    for (name, kind) in [("linear", Stage::Linear), ("mlp", Stage::Mlp)] {
        let mut stage = online(&CompressorConfig { stage: kind, ..CompressorConfig::default() });
        let mut written: Vec<MeasuredCodes> = Vec::new();
        let mut times = Vec::new();
        for (at, codes) in codes.iter().enumerate() {
            let before = stage.boxed_clone();
            let started = Instant::now();
            let advanced = stage.observe(codes);
            times.push(started.elapsed().as_secs_f32() * 1e3);
            for keyframe in written.iter_mut().filter(|_| advanced) {
                carry_over(&*before, &*stage, &mut keyframe.carried);
            }
            let truth = sampled(codes);
            let code = stage.encode(&truth);
            written.push(MeasuredCodes { truth, carried: code.clone(), frozen: code });
            let carried = |codes: &MeasuredCodes| cosine(&*stage, &codes.carried, &codes.truth);
            let frozen = |codes: &MeasuredCodes| cosine(&*stage, &codes.frozen, &codes.truth);
            writeln!(
                csv,
                "{},{name},{at},{:.4},{:.4},{:.4},{:.4},{:.3}",
                arguments.scene,
                carried(&written[0]),
                frozen(&written[0]),
                mean(written.iter().map(carried)),
                mean(written.iter().map(frozen)),
                times[at]
            )?;
        }
        let median = median(times);
        println!("{} {name}: {median:.2} ms to learn from a keyframe (median)", arguments.scene);
    }
    Ok(())
}
