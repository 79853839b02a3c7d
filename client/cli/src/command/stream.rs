//! `lexsplat stream`: sends a data set to a server, with a progress bar on standard error and the
//! summary on standard output.

use crate::access::AccessOptions;
use crate::choices::{Encoder, Poses};
use crate::dataset::DatasetSpec;
use crate::output::OutputError;
use crate::progress::{progress_bar, show, tell_left_out};
use crate::sensing::Sensing;
use anyhow::{Result, bail};
use lexsplat_client::dataset::FrameRange;
use lexsplat_client::stream::{StreamOptions, Summary, stream};
use std::num::NonZeroUsize;
use std::sync::Arc;

/// Stream a data set to a server; frames that the map has already are not sent again
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  lexsplat stream --dataset synthetic:7\n  \
                        lexsplat stream --dataset replica:room0 --map room0 --stride 2\n  \
                        lexsplat stream --dataset 7scenes:redkitchen/seq-01 --realtime\n  \
                        lexsplat stream --dataset 'mcap:walk.mcap?color=/rgb/image_raw&world=odom'\n  \
                        lexsplat stream --dataset replica:room0 --sensor kinect --blackout 100..110")]
pub struct Stream {
    /// replica:PATH, tum:PATH, 7scenes:PATH, nerfstudio:PATH, folder:PATH, mcap:PATH, rosbag2:PATH,
    /// r3d:FILE, scannet:FILE, synthetic or synthetic:SEED
    #[arg(long, value_name = "KIND:PATH")]
    dataset: DatasetSpec,
    #[command(flatten)]
    sensing: Sensing,
    /// Map to create or resume; the data set's name if not given
    #[arg(long, value_name = "NAME")]
    map: Option<String>,
    /// Where poses come from
    #[arg(long, value_enum, default_value_t = Poses::Given)]
    poses: Poses,
    /// Where language comes from
    #[arg(long, value_enum, default_value_t = Encoder::Bundle)]
    encoder: Encoder,
    /// First frame, counted from 0
    #[arg(long, value_name = "A", default_value_t = 0)]
    start: usize,
    /// Frame after the last
    #[arg(long, value_name = "B")]
    end: Option<usize>,
    /// Use every K-th frame
    #[arg(long, value_name = "K", default_value = "1")]
    stride: NonZeroUsize,
    /// Send at the pace of the frames' timestamps
    #[arg(long)]
    realtime: bool,
    /// The server's gRPC address
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:50051")]
    grpc: String,
    #[command(flatten)]
    access: AccessOptions,
    /// Print the summary as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub async fn run(arguments: &Stream) -> Result<()> {
    let range = FrameRange {
        start: arguments.start,
        end: arguments.end,
        stride: arguments.stride,
        ..FrameRange::default()
    };
    let poses = arguments.poses.into();
    let dataset = arguments.sensing.open(&arguments.dataset, range, poses)?;
    let options = StreamOptions {
        grpc: arguments.grpc.clone(),
        access: arguments.access.read()?,
        map: arguments.map.clone().unwrap_or_else(|| dataset.name().to_owned()),
        poses,
        encoder: arguments.encoder.into(),
        hold_out_every: None,
        realtime: arguments.realtime,
    };
    let bar = progress_bar(dataset.len() as u64);
    let summary = stream(Arc::from(dataset), &options, |progress| show(&bar, progress)).await;
    match &summary {
        Ok(_) => bar.finish(),
        Err(_) => bar.abandon(),
    }
    let summary = summary?;
    tell_left_out(&summary);
    if arguments.json {
        say!("{}", serde_json::to_string(&summary)?)?;
    } else {
        print(&summary)?;
    }
    match &summary.refusals[..] {
        [first, ..] if summary.refused == summary.sent => bail!(
            "the server refused all {} frames; frame {}: {}: {}",
            summary.sent,
            first.sequence,
            first.field,
            first.reason
        ),
        _ => Ok(()),
    }
}

fn print(summary: &Summary) -> Result<(), OutputError> {
    let Summary { map, sent, tracked, lost, refused, .. } = summary;
    if summary.resumed_past > 0 {
        say!("map {map}: {} frames were there already", summary.resumed_past)?;
    }
    if *sent == 0 {
        return Ok(());
    }
    say!(
        "map {map}: {sent} frames in {:.1} s ({:.2} frames/s): {tracked} tracked, {lost} lost, \
         {refused} refused, {} keyframes",
        summary.seconds,
        summary.frames_per_second,
        summary.keyframes.len()
    )?;
    for refusal in &summary.refusals {
        say!("refused frame {}: {}: {}", refusal.sequence, refusal.field, refusal.reason)?;
    }
    match summary.durable_through {
        Some(sequence) => say!("durable through frame {sequence}"),
        None => say!("not durable: the server has no data directory"),
    }
}
