//! `lexsplat demo`: starts a server, streams a data set to it, asks five questions and writes
//! images of the answers. The exit code is 1 if a step fails; wrong answers are no failures.

mod ask;
mod questions;
mod report;

use crate::choices::Poses;
use crate::dataset::DatasetSpec;
use crate::files::make_folder;
use crate::progress::{progress_bar, show, tell_left_out};
use crate::runtime::interrupted;
use crate::sensing::Sensing;
use crate::server::{self, Plan, Server};
use anyhow::{Context as _, Result, bail};
use ask::{Asked, Asker};
use image::RgbImage;
use indicatif::ProgressBar;
use lexsplat_client::Access;
use lexsplat_client::dataset::{Dataset, FrameRange};
use lexsplat_client::http::{HttpClient, Status};
use lexsplat_client::stream::{Encoder, StreamOptions, stream};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Start a server, map a data set, ask five questions and write pictures of the answers
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  lexsplat demo\n  \
                        lexsplat demo --dataset replica:room0 --stride 4 --ask 'blue sofa' --keep")]
pub struct Demo {
    /// replica:PATH, tum:PATH, 7scenes:PATH, nerfstudio:PATH, folder:PATH, mcap:PATH, rosbag2:PATH,
    /// r3d:FILE, scannet:FILE, synthetic or synthetic:SEED
    #[arg(long, value_name = "KIND:PATH", default_value = "synthetic:7")]
    dataset: DatasetSpec,
    #[command(flatten)]
    sensing: Sensing,
    /// Where poses come from
    #[arg(long, value_enum, default_value_t = Poses::Estimate)]
    poses: Poses,
    /// Ask this instead of the usual five questions; may be repeated
    #[arg(long, value_name = "TEXT")]
    ask: Vec<String>,
    /// Folder for pictures, heat maps, report.md and server.log; made if missing
    #[arg(long, value_name = "DIR", default_value = "demo-out")]
    out: PathBuf,
    /// Leave the server up until Ctrl-C
    #[arg(long)]
    keep: bool,
    /// The server's binary; absent: the one beside this program
    #[arg(long, value_name = "PATH")]
    server: Option<PathBuf>,
    /// Settings of the server; absent: its own
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// The folder of a bundle of networks; absent: what the settings say
    #[arg(long, value_name = "DIR")]
    models: Option<PathBuf>,
    /// First frame, counted from 0
    #[arg(long, value_name = "A", default_value_t = 0)]
    start: usize,
    /// Frame after the last
    #[arg(long, value_name = "B")]
    end: Option<usize>,
    /// Use every K-th frame
    #[arg(long, value_name = "K", default_value = "1")]
    stride: NonZeroUsize,
}

const POLL: Duration = Duration::from_millis(250);

/// Runs the command.
pub async fn run(arguments: &Demo) -> Result<()> {
    let range = FrameRange {
        start: arguments.start,
        end: arguments.end,
        stride: arguments.stride,
        ..FrameRange::default()
    };
    let poses = arguments.poses.into();
    let dataset = arguments.sensing.open(&arguments.dataset, range, poses)?;
    let dataset: Arc<dyn Dataset> = Arc::from(dataset);
    let out = &arguments.out;
    make_folder(out)?;
    let plan = Plan {
        program: arguments.server.clone().map_or_else(server::beside_this, Ok)?,
        config: arguments.config.clone(),
        models: arguments.models.clone(),
        settings: Vec::new(),
        log: out.join("server.log"),
    };
    let starting = ProgressBar::new_spinner().with_message("the server starts");
    starting.enable_steady_tick(POLL);
    let started = Server::start(&plan).await;
    starting.finish_and_clear();
    let mut server = started?;
    let ready = server.ready.clone();
    tokio::select! {
        shown = show_all(arguments, &ready, dataset) => shown.map_err(|error| server.explain(error))?,
        pressed = interrupted() => pressed.and_then(|()| bail!("interrupted"))?,
    }
    if arguments.keep {
        say!("the server is up until Ctrl-C")?;
        interrupted().await?;
    }
    server.stop()
}

async fn show_all(
    arguments: &Demo,
    ready: &server::Ready,
    dataset: Arc<dyn Dataset>,
) -> Result<()> {
    say!("server on {}, networks {}", ready.adapter, ready.bundle)?;
    let client = HttpClient::new(&ready.http)?;
    let map = dataset.name().to_owned();
    let options = StreamOptions {
        grpc: ready.grpc.clone(),
        access: Access::default(),
        map: map.clone(),
        poses: arguments.poses.into(),
        encoder: Encoder::Bundle,
        hold_out_every: None,
        realtime: false,
    };
    let made = map_it(&options, dataset.clone()).await?;
    let status = settle(&client, &map).await?;
    let made =
        format!("{made}; {} Gaussians from {} keyframes", status.gaussians, status.keyframes);
    say!("{made}")?;

    let asker = Asker { client: &client, map: &map, dataset: &*dataset };
    let bar = ProgressBar::new_spinner().with_message("asking");
    bar.enable_steady_tick(POLL);
    let on_answer = |one: &Asked| bar.set_message(format!("asking: {}", one.text));
    let asked = asker.ask_all(&arguments.dataset, &arguments.ask, on_answer).await;
    bar.finish_and_clear();
    let asked = asked?;
    say_part!("\n{}", report::answers_table(&asked))?;
    if let Some(line) = report::verdicts(&asked) {
        say!("\n{line}")?;
    }
    let pictures = pictures(&asker, &asked).await?;
    let heading = format!("{map}: {made}");
    report::write(&arguments.out, &asked, &pictures, &heading)?;
    say!("\npictures   {}", arguments.out.join("report.md").display())?;
    let kept = if arguments.keep { "" } else { " (--keep leaves the server up)" };
    say!("dashboard  http://{}/{kept}", ready.http)?;
    Ok(())
}

/// Streams the data set; returns a line about the outcome.
async fn map_it(options: &StreamOptions, dataset: Arc<dyn Dataset>) -> Result<String> {
    let bar = progress_bar(dataset.len() as u64);
    let summary = stream(dataset, options, |progress| show(&bar, progress)).await;
    match &summary {
        Ok(_) => bar.finish(),
        Err(_) => bar.abandon(),
    }
    let summary = summary?;
    tell_left_out(&summary);
    if summary.tracked == 0 {
        let reason = summary.refusals.first().map_or("none was tracked", |first| &first.reason);
        bail!("none of {} frames is in the map: {reason}", summary.sent);
    }
    Ok(format!(
        "{} of {} frames mapped at {:.2} frames/s",
        summary.tracked, summary.sent, summary.frames_per_second
    ))
}

/// Waits until the map is settled.
async fn settle(client: &HttpClient, map: &str) -> Result<Status> {
    let bar = ProgressBar::new_spinner();
    bar.enable_steady_tick(POLL);
    let on_status = |status: &Status| {
        bar.set_message(format!(
            "the map settles: {} keyframes, {} Gaussians",
            status.keyframes, status.gaussians
        ));
    };
    let settled = client.settled(map, on_status).await;
    bar.finish_and_clear();
    Ok(settled?)
}

async fn pictures(asker: &Asker<'_>, asked: &[Asked]) -> Result<Vec<RgbImage>> {
    let mut pictures = Vec::new();
    for one in asked {
        let frame = asker.dataset.frame(one.view.index)?;
        let frame = frame.rgb(&asker.dataset.intrinsics())?;
        let render = asker.client.render_png(asker.map, one.view.sequence).await?;
        let render = image::load_from_memory(&render).context("the server's picture")?;
        pictures.push(report::picture(one, &frame, &render.to_rgb8()));
    }
    Ok(pictures)
}
