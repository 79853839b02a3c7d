//! `lexsplat evaluate`: measures a data set on a server of its own, or on one that runs. Progress on
//! standard error, a table on standard output, report and pictures in a folder.

use super::interrupted;
use super::server::{self, Plan, Server};
use super::stream::{progress_bar, show};
use super::table::{Align, table};
use crate::choices::{Encoder, Poses};
use crate::dataset::DatasetSpec;
use anyhow::{Context as _, Result, bail};
use indicatif::ProgressBar;
use lexsplat_client::dataset::{Dataset, FrameRange};
use lexsplat_client::stream;
use lexsplat_evaluate::{
    Evaluation, Lpips, Options, Report, Step, Target, evaluate, markdown, plot, rows,
};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// With the true classes' names 0.5 must lie elsewhere than with a bundle's features: of the house's 39
/// classes each has a margin of 0.75 to 1.0 to its own word, and of 0.6 at most to words of what resembles
/// it. The middle, times the temperature of 10.
const ORACLE_BIAS: (&str, &str) = ("QUERY__BIAS", "5.1");

/// Measure speed, trajectory, pictures and words on a data set, beside the paper's figures
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  lexsplat evaluate --dataset replica:room0 --language --out room0-report\n  \
                  lexsplat evaluate --dataset synthetic:7 --frames 60\n  \
                  lexsplat evaluate --dataset replica:room0 --language --encoder oracle\n  \
                  lexsplat evaluate --dataset tum:fr3_office --poses estimate \
                  --grpc 127.0.0.1:50051 --http 127.0.0.1:8080"
)]
pub struct Evaluate {
    /// replica:PATH, tum:PATH, 7scenes:PATH or synthetic[:SEED]
    #[arg(long, value_name = "KIND:PATH")]
    dataset: DatasetSpec,
    /// Where the map's poses come from
    #[arg(long, value_enum, default_value_t = Poses::Given)]
    poses: Poses,
    /// Where language comes from: "oracle" gives the true classes' names, to measure what the map loses
    #[arg(long, value_enum, default_value_t = Encoder::Bundle)]
    encoder: Encoder,
    /// Every K-th frame is tracked and never a keyframe, and pictures are scored on these; 0: none is
    #[arg(long, value_name = "K", default_value_t = 8)]
    held_out: usize,
    /// Only the first N frames (after --stride)
    #[arg(long, value_name = "N")]
    frames: Option<NonZeroUsize>,
    /// Use every K-th frame
    #[arg(long, value_name = "K", default_value = "1")]
    stride: NonZeroUsize,
    /// Go through them there and back, N times in all: a long walk through what is known
    #[arg(long, value_name = "N", default_value = "1")]
    passes: NonZeroUsize,
    /// Ask for the most visible classes and score the answers; needs masks
    #[arg(long)]
    language: bool,
    /// Score pictures with LPIPS as well, by this network: ONNX, two pictures [1, 3, height, width] in -1..1 in,
    /// one number out; ORT_DYLIB_PATH names ONNX Runtime's library
    #[arg(long, value_name = "FILE")]
    lpips: Option<PathBuf>,
    /// Folder for report.json, report.md, plots, pictures and server.log; made if missing
    #[arg(long, value_name = "DIR", default_value = "evaluate-out")]
    out: PathBuf,
    /// A running server's gRPC address; absent: a server is started
    #[arg(long, value_name = "ADDR", requires = "http", conflicts_with_all = ["server", "config", "models"])]
    grpc: Option<String>,
    /// The same server's HTTP address
    #[arg(long, value_name = "ADDR", requires = "grpc")]
    http: Option<String>,
    /// Map to make; the data set's name if not given
    #[arg(long, value_name = "NAME")]
    map: Option<String>,
    /// The binary of the server to start; absent: the one beside this program
    #[arg(long, value_name = "PATH")]
    server: Option<PathBuf>,
    /// Settings of the server to start; absent: its own
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// The folder of a bundle of networks; absent: what the settings say
    #[arg(long, value_name = "DIR")]
    models: Option<PathBuf>,
}

/// Runs the command.
pub async fn run(arguments: &Evaluate) -> Result<()> {
    let (stride, passes) = (arguments.stride, arguments.passes);
    let end = arguments.frames.map(|frames| frames.get().saturating_mul(stride.get()));
    let dataset: Arc<dyn Dataset> =
        Arc::from(arguments.dataset.open(FrameRange { start: 0, end, stride, passes })?);
    for (asked, option) in [
        (arguments.language, "--language"),
        (arguments.encoder == Encoder::Oracle, "--encoder oracle"),
    ] {
        if asked && dataset.truth().is_none() {
            bail!("{option}: {} has no masks: leave it out", arguments.dataset);
        }
    }
    let out = &arguments.out;
    std::fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
    let options = Options {
        poses: arguments.poses.into(),
        encoder: arguments.encoder.into(),
        hold_out_every: NonZeroUsize::new(arguments.held_out),
        language: arguments.language,
        lpips: arguments.lpips.as_deref().map(Lpips::load).transpose()?,
    };
    if let (Some(grpc), Some(http)) = (&arguments.grpc, &arguments.http) {
        let map = arguments.map.clone().unwrap_or_else(|| dataset.name().to_owned());
        let target = Target { grpc: grpc.clone(), http: http.clone(), map };
        return shown(arguments, &measure(dataset, &target, options).await?);
    }
    let plan = Plan {
        program: arguments.server.clone().map_or_else(server::beside_this, Ok)?,
        config: arguments.config.clone(),
        models: arguments.models.clone(),
        settings: Vec::new(),
        log: out.join("server.log"),
    };
    let evaluation = measure_own(plan, dataset, arguments.map.clone(), options).await?;
    shown(arguments, &evaluation)
}

/// Measures on a server that is started for it and stopped, in a map of this name (absent: the data
/// set's).
///
/// # Errors
/// What the server, the data set or the network say.
pub(super) async fn measure_own(
    mut plan: Plan,
    dataset: Arc<dyn Dataset>,
    map: Option<String>,
    options: Options,
) -> Result<Evaluation> {
    if options.encoder == stream::Encoder::Oracle {
        plan.settings.push(ORACLE_BIAS);
    }
    let settings = settings(&plan)?;
    let mut server = Server::start(&plan).await?;
    let (grpc, http) = (server.ready.grpc.clone(), server.ready.http.clone());
    let map = map.unwrap_or_else(|| dataset.name().to_owned());
    let target = Target { grpc, http, map };
    let mut evaluation = tokio::select! {
        done = measure(dataset, &target, options) => done.map_err(|error| server.explain(error))?,
        pressed = interrupted() => pressed.and_then(|()| bail!("interrupted"))?,
    };
    server.stop()?;
    evaluation.report.config = Some(settings);
    Ok(evaluation)
}

/// The settings that the server will have, as TOML.
fn settings(plan: &Plan) -> Result<String> {
    let said = plan
        .command()
        .arg("--print-config")
        .output()
        .with_context(|| format!("cannot start {}", plan.program.display()))?;
    if !said.status.success() {
        let reason = String::from_utf8_lossy(&said.stderr);
        bail!("the server refuses its settings: {}", reason.trim());
    }
    String::from_utf8(said.stdout).context("the server's settings are not text")
}

async fn measure(
    dataset: Arc<dyn Dataset>,
    target: &Target,
    options: Options,
) -> Result<Evaluation> {
    let mut bars = Bars::new(dataset.len() as u64);
    let measured = evaluate(dataset, target, options, |step| bars.show(step)).await;
    bars.current.finish_and_clear();
    Ok(measured?)
}

fn shown(arguments: &Evaluate, evaluation: &Evaluation) -> Result<()> {
    print(&evaluation.report);
    let page = write(&arguments.out, evaluation)?;
    println!("\nreport     {}", page.display());
    Ok(())
}

/// One bar after the other.
struct Bars {
    current: ProgressBar,
    doing: &'static str,
}

impl Bars {
    fn new(frames: u64) -> Self {
        Self { current: progress_bar(frames), doing: "streaming" }
    }

    fn show(&mut self, step: Step<'_>) {
        match step {
            Step::Streaming(progress) => show(&self.current, progress),
            Step::Settling(status) => self.begin("settling", 0).set_message(format!(
                "the map settles: {} keyframes, {} Gaussians",
                status.keyframes, status.gaussians
            )),
            Step::Rendering { done, of } => self.begin("comparing", of).set_position(done as u64),
            Step::Locating { done, of } => self.begin("locating", of).set_position(done as u64),
            Step::Judging { done, of } => self.begin("judging", of).set_position(done as u64),
            Step::Asking { done, of } => self.begin("asking", of).set_position(done as u64),
        }
    }

    fn begin(&mut self, doing: &'static str, of: usize) -> &ProgressBar {
        if self.doing != doing {
            self.current.finish();
            self.current = progress_bar(of as u64).with_message(doing);
            self.doing = doing;
        }
        &self.current
    }
}

fn print(report: &Report) {
    let cells: Vec<Vec<String>> = rows(report)
        .into_iter()
        .map(|row| vec![row.what.to_owned(), row.value, row.paper])
        .collect();
    let columns =
        [("what", Align::Left), ("here", Align::Right), ("paper (Replica)", Align::Right)];
    println!("{} on {}, networks {}\n", report.dataset, report.adapter, report.bundle);
    print!("{}", table(&columns, &cells));
    let Some(language) = &report.language else { return };
    let rows: Vec<Vec<String>> = language
        .classes
        .iter()
        .map(|class| {
            let m = &class.means;
            let numbers = [m.share, m.miou_paper, m.miou_bundle, m.loc_box, m.average_precision];
            let cells = [class.label.clone(), class.frames.to_string()].into_iter();
            cells.chain(numbers.map(|number| format!("{number:.3}"))).collect()
        })
        .collect();
    let threshold = format!("IoU at {:.2}", language.bundle_threshold);
    let columns = ["class", "frames", "share", "IoU at 0.5", &threshold, "Loc", "AP"]
        .map(|name| (name, if name == "class" { Align::Left } else { Align::Right }));
    print!("\n{}", table(&columns, &rows));
}

/// Writes everything; returns the page to open.
pub(super) fn write(out: &Path, evaluation: &Evaluation) -> Result<PathBuf> {
    let Evaluation { report, trajectory, trajectory_tum, samples } = evaluation;
    let plots = [
        ("trajectory.png", "Trajectory from above", plot::trajectory(trajectory)),
        ("psnr.png", "PSNR over frames", plot::psnr(&report.views)),
        (
            "reliability.png",
            "Confidence and truth",
            report.presence.as_ref().and_then(plot::reliability),
        ),
        ("stages.png", "Stage times", plot::stages(&report.stages, report.frames)),
    ];
    let plots = plots.into_iter().filter_map(|(file, caption, picture)| {
        Some((file.to_owned(), caption.to_owned(), picture?))
    });
    let samples = samples
        .iter()
        .map(|one| (format!("{}.png", one.name), one.caption.clone(), one.picture.clone()));
    let mut pictures = Vec::new();
    for (file, caption, picture) in plots.chain(samples) {
        let path = out.join(&file);
        picture.save(&path).with_context(|| format!("cannot write {}", path.display()))?;
        pictures.push((file, caption));
    }
    let page = out.join("report.md");
    let texts = [
        (out.join("report.json"), serde_json::to_string_pretty(report)?),
        (out.join("trajectory.tum"), trajectory_tum.clone()),
        (page.clone(), markdown(report, &pictures)),
    ];
    for (path, text) in texts {
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(page)
}
