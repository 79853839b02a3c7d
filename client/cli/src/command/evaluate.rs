//! `lexsplat evaluate`: measures a data set on its own server or on a running one. Progress goes to
//! standard error, a table to standard output, report and images to a folder.

use super::measure::{measure, measure_own, write};
use super::versus::Turns;
use crate::access::AccessOptions;
use crate::choices::{Encoder, Poses};
use crate::dataset::DatasetSpec;
use crate::files::make_folder;
use crate::output::OutputError;
use crate::sensing::Sensing;
use crate::server::{self, Plan};
use anyhow::{Result, bail};
use lexsplat_client::dataset::{Against, Dataset, FrameRange};
use lexsplat_evaluate::table::{Column, table};
use lexsplat_evaluate::{
    Evaluation, LabelFile, LabelSource, Lpips, Options, Report, Target, label_table, rows,
};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;

/// Measure speed, trajectory, views and language on a data set, beside the paper's figures
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  lexsplat evaluate --dataset replica:room0 --language --out room0-report\n  \
                  lexsplat evaluate --dataset synthetic:7 --frames 60\n  \
                  lexsplat evaluate --dataset replica:room0 --language --encoder oracle\n  \
                  lexsplat evaluate --dataset synthetic:7 --poses estimate --sensor d435 --shake 0.5\n  \
                  lexsplat evaluate --dataset replica:room0 --frames 60 --versus old/lexsplat-server\n  \
                  lexsplat evaluate --dataset 7scenes:kitchen --labels kitchen/labels.json\n  \
                  lexsplat evaluate --dataset tum:fr3_office --poses estimate \
                  --grpc 127.0.0.1:50051 --http 127.0.0.1:8080"
)]
pub struct Evaluate {
    /// replica:PATH, tum:PATH, 7scenes:PATH, nerfstudio:PATH, folder:PATH, mcap:PATH, rosbag2:PATH,
    /// r3d:FILE, scannet:FILE, synthetic or synthetic:SEED
    #[arg(long, value_name = "KIND:PATH")]
    dataset: DatasetSpec,
    /// Score views and answers against the frames of this data set that have the same numbers: the same walk
    /// seen by an ideal camera
    #[arg(long, value_name = "KIND:PATH", conflicts_with = "sensor")]
    against: Option<DatasetSpec>,
    #[command(flatten)]
    sensing: Sensing,
    /// Where the map's poses come from
    #[arg(long, value_enum, default_value_t = Poses::Given)]
    poses: Poses,
    /// Where language comes from; "oracle" uses the true classes' names, to measure the loss of the
    /// map
    #[arg(long, value_enum, default_value_t = Encoder::Bundle)]
    encoder: Encoder,
    /// Hold out every K-th frame: tracked, never a keyframe, and scored; 0: none
    #[arg(long, value_name = "K", default_value_t = 8)]
    held_out: usize,
    /// Only the first N frames (after --stride)
    #[arg(long, value_name = "N")]
    frames: Option<NonZeroUsize>,
    /// Use every K-th frame
    #[arg(long, value_name = "K", default_value = "1")]
    stride: NonZeroUsize,
    /// Go through the frames N times, forwards and backwards: a long walk through a known scene
    #[arg(long, value_name = "N", default_value = "1")]
    passes: NonZeroUsize,
    /// Score the map after it was refined; without this a server that is started does not refine
    #[arg(long)]
    converged: bool,
    /// Ask for the most visible classes and score the answers; needs masks
    #[arg(long)]
    language: bool,
    /// Ask for the labels of this file in its frames and score the answers; for data sets without masks
    #[arg(long, value_name = "FILE", conflicts_with_all = ["language", "passes"])]
    labels: Option<PathBuf>,
    /// Score views with LPIPS by this ONNX network: in two images [1, 3, height, width] in -1..1,
    /// out one number; ORT_DYLIB_PATH names ONNX Runtime's library
    #[arg(long, value_name = "FILE")]
    lpips: Option<PathBuf>,
    /// Compare the server with this binary of another build: both are measured in turns with the same
    /// options, and ratios with their spread are printed and written to versus.json
    #[arg(long, value_name = "BINARY", conflicts_with = "grpc")]
    versus: Option<PathBuf>,
    /// How often --versus measures each build
    #[arg(long, value_name = "N", default_value = "2", requires = "versus")]
    rounds: NonZeroUsize,
    /// Folder for report.json, report.md, plots, pictures and server.log, with --versus for a folder of
    /// them for each turn; made if missing
    #[arg(long, value_name = "DIR", default_value = "evaluate-out")]
    out: PathBuf,
    /// A running server's gRPC address; absent: a server is started
    #[arg(long, value_name = "ADDR", requires = "http", conflicts_with_all = ["server", "config", "models"])]
    grpc: Option<String>,
    /// The same server's HTTP address
    #[arg(long, value_name = "ADDR", requires = "grpc")]
    http: Option<String>,
    #[command(flatten)]
    access: AccessOptions,
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
    let dataset = open(arguments)?;
    let out = &arguments.out;
    make_folder(out)?;
    let options = || options(arguments);
    let map = arguments.map.clone();
    if let (Some(grpc), Some(http)) = (&arguments.grpc, &arguments.http) {
        let target = Target {
            grpc: grpc.clone(),
            http: http.clone(),
            access: arguments.access.read()?,
            map: map.unwrap_or_else(|| dataset.name().to_owned()),
            process: None,
        };
        return shown(arguments, &measure(dataset, &target, options()?).await?);
    }
    let program = arguments.server.clone().map_or_else(server::beside_this, Ok)?;
    let plan = |program: PathBuf, log: PathBuf| Plan {
        program,
        config: arguments.config.clone(),
        models: arguments.models.clone(),
        settings: Vec::new(),
        log,
    };
    if let Some(other) = &arguments.versus {
        let (builds, rounds) = ([program, other.clone()], arguments.rounds);
        let turns = Turns { builds, plan: &plan, options: &options, dataset, map, rounds, out };
        return turns.run().await;
    }
    let plan = plan(program, out.join("server.log"));
    shown(arguments, &measure_own(plan, dataset, map, options()?).await?)
}

/// The frames to send, which have what the options ask for.
fn open(arguments: &Evaluate) -> Result<Arc<dyn Dataset>> {
    let (stride, passes) = (arguments.stride, arguments.passes);
    let end = arguments.frames.map(|frames| frames.get().saturating_mul(stride.get()));
    let range = FrameRange { start: 0, end, stride, passes };
    let dataset = arguments.sensing.open(&arguments.dataset, range, arguments.poses.into())?;
    let dataset: Arc<dyn Dataset> = match &arguments.against {
        Some(clean) => Arc::new(Against::new(dataset, clean.whole(0.0, Poses::Given.into())?)?),
        None => Arc::from(dataset),
    };
    if !dataset.cameras().are_registered() && arguments.against.is_none() {
        bail!(
            "{}: its lenses are not straight, or depth has a camera of its own, so its pictures are not what \
             the map shows: name the same walk seen by an ideal camera with --against, or use `lexsplat stream`",
            arguments.dataset
        );
    }
    for (asked, option) in [
        (arguments.language, "--language"),
        (arguments.encoder == Encoder::Oracle, "--encoder oracle"),
    ] {
        if option != "--language" && asked && arguments.against.is_some() {
            bail!(
                "{option}: the masks of --against are not of the frames that are sent: leave it out"
            );
        }
        if asked && dataset.truth().is_none() {
            bail!(
                "{option}: {} has no masks: leave it out, or name a file of labels with --labels",
                arguments.dataset
            );
        }
    }
    Ok(dataset)
}

/// What is asked.
fn labels(arguments: &Evaluate) -> Result<Option<LabelSource>> {
    let Some(path) = &arguments.labels else {
        return Ok(arguments.language.then_some(LabelSource::Masks));
    };
    // Also frames that are not sent, or have no pose, are frames of the data set.
    let whole = arguments.dataset.whole(0.0, Poses::Estimate.into())?;
    Ok(Some(LabelSource::File(LabelFile::read(path, &*whole)?)))
}

/// What to measure.
fn options(arguments: &Evaluate) -> Result<Options> {
    Ok(Options {
        poses: arguments.poses.into(),
        encoder: arguments.encoder.into(),
        hold_out_every: NonZeroUsize::new(arguments.held_out),
        converged: arguments.converged,
        labels: labels(arguments)?,
        lpips: arguments.lpips.as_deref().map(Lpips::load).transpose()?,
    })
}

fn shown(arguments: &Evaluate, evaluation: &Evaluation) -> Result<()> {
    print(&evaluation.report)?;
    let page = write(&arguments.out, evaluation)?;
    say!("\nreport     {}", page.display())?;
    Ok(())
}

fn print(report: &Report) -> Result<(), OutputError> {
    let cells: Vec<Vec<String>> = rows(report)
        .into_iter()
        .map(|row| vec![row.what.to_owned(), row.value, row.paper])
        .collect();
    let columns = [Column::left("what"), Column::right("here"), Column::right("paper (Replica)")];
    say!("{} on {}, networks {}\n", report.dataset, report.adapter, report.bundle)?;
    say_part!("{}", table(&columns, &cells))?;
    let Some(language) = &report.language else { return Ok(()) };
    let labels = label_table(language, report.presence.as_ref(), true);
    say_part!("\n{}", table(&labels.columns(), &labels.rows))
}
