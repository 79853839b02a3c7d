//! `lexsplat synth`: writes a synthetic room as a folder in Replica layout.

use crate::sensing::Sensing;
use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use lexsplat_client::dataset::FrameRange;
use lexsplat_synthetic::{Camera, SyntheticDataset, Walk, write_dataset};
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Write a synthetic furnished room as a data set in Replica layout
#[derive(clap::Args)]
#[command(after_help = "Example:\n  lexsplat synth --seed 7 --frames 150 room7\n  \
                        lexsplat stream --dataset replica:room7\n  \
                        lexsplat synth --seed 7 --sensor kinect room7-kinect")]
pub struct Synth {
    /// Which room: the same seed gives the same bytes
    #[arg(long, default_value_t = 7)]
    seed: u64,
    /// Length of the camera's walk; about 180 frames see the whole room
    #[arg(long, default_value_t = 150, value_parser = clap::value_parser!(u32).range(1..100_000))]
    frames: u32,
    /// Render only every K-th frame of the walk
    #[arg(long, value_name = "K", default_value = "1")]
    every: NonZeroUsize,
    /// Pixels
    #[arg(long, default_value_t = 320, value_parser = clap::value_parser!(u32).range(16..4096))]
    width: u32,
    /// Pixels
    #[arg(long, default_value_t = 240, value_parser = clap::value_parser!(u32).range(16..4096))]
    height: u32,
    #[command(flatten)]
    sensing: Sensing,
    /// Folder to write to; made if missing
    dir: PathBuf,
}

/// Runs the command.
pub fn run(arguments: &Synth) -> Result<()> {
    let walk = Walk {
        seed: arguments.seed,
        frames: arguments.frames as usize,
        camera: Camera::new(arguments.width, arguments.height),
        shake_radians: arguments.sensing.shake_radians(),
    };
    let range = FrameRange { stride: arguments.every, ..FrameRange::default() };
    let dataset = arguments.sensing.applied(Box::new(SyntheticDataset::of(&walk)), range)?;
    let bar = ProgressBar::new(dataset.len() as u64);
    bar.set_style(ProgressStyle::with_template(
        "{bar:30} {pos}/{len} frames, {eta} left  {per_sec}",
    )?);
    write_dataset(&arguments.dir, &*dataset, |done| bar.set_position(done as u64))?;
    bar.finish();
    say!("wrote {} frames to {}", bar.length().unwrap_or(0), arguments.dir.display())?;
    Ok(())
}
