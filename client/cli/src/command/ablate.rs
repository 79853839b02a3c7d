//! `lexsplat ablate`: the paper's ablations on one data set, each variant on its own server.
//! Progress goes to standard error, one table to standard output, the full report of every variant
//! to a folder.
//!
//! A variant is the default with some settings changed. All variants are measured in one run, so
//! that their times can be compared even if the speed of the machine changes from day to day.

use super::measure::{measure_own, write};
use crate::dataset::DatasetSpec;
use crate::files::{make_folder, save};
use crate::sensing::Sensing;
use crate::server::{Plan, beside_this};
use anyhow::{Result, bail};
use lexsplat_client::dataset::{Dataset, FrameRange};
use lexsplat_client::stream::{Encoder, Poses};
use lexsplat_evaluate::table::{Column, markdown_table, table};
use lexsplat_evaluate::{LabelSource, Options, Report};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;

/// Measure what each part of the method brings: joint or disentangled heads, online stages,
/// trackers
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  lexsplat ablate --dataset replica:room0 --out room0-ablation\n  \
                  lexsplat ablate --dataset synthetic:7 --frames 60 --only disentangled --only joint"
)]
pub struct Ablate {
    /// replica:PATH, tum:PATH, 7scenes:PATH, nerfstudio:PATH, folder:PATH, mcap:PATH, rosbag2:PATH,
    /// r3d:FILE, scannet:FILE, synthetic or synthetic:SEED
    #[arg(long, value_name = "KIND:PATH")]
    dataset: DatasetSpec,
    #[command(flatten)]
    sensing: Sensing,
    /// Only the first N frames (after --stride)
    #[arg(long, value_name = "N")]
    frames: Option<NonZeroUsize>,
    /// Use every K-th frame
    #[arg(long, value_name = "K", default_value = "1")]
    stride: NonZeroUsize,
    /// Only this variant; may be given several times
    #[arg(long, value_name = "NAME", value_parser = names())]
    only: Vec<String>,
    /// Folder for ablation.md and a folder per variant; made if missing
    #[arg(long, value_name = "DIR", default_value = "ablation-out")]
    out: PathBuf,
    /// The binary of the server to start; absent: the one beside this program
    #[arg(long, value_name = "PATH")]
    server: Option<PathBuf>,
    /// The folder of a bundle of networks; absent: what the settings say
    #[arg(long, value_name = "DIR")]
    models: Option<PathBuf>,
}

/// The default with some settings changed.
struct Variant {
    name: &'static str,
    /// Description for the table.
    about: &'static str,
    /// (`LEXSPLAT__SECTION__KEY` without the prefix, value).
    settings: &'static [(&'static str, &'static str)],
    encoder: Encoder,
}

const ROTATION: (&str, &str) = ("MAPPER__TIES__ROTATION", "true");
const SCALE: (&str, &str) = ("MAPPER__TIES__SCALE", "true");
const OPACITY: (&str, &str) = ("MAPPER__TIES__OPACITY", "true");

/// All variants, in the order of the table.
const VARIANTS: [Variant; 12] = [
    Variant::oracle("disentangled", "the default: each head has its own shape", &[]),
    Variant::oracle("joint", "one shape for color and language", &[ROTATION, SCALE, OPACITY]),
    Variant::oracle("tied-rotation", "one rotation", &[ROTATION]),
    Variant::oracle("tied-scale", "one scale", &[SCALE]),
    Variant::oracle("tied-opacity", "one opacity", &[OPACITY]),
    Variant::oracle("mlp", "the paper's auto-encoder online", &[("COMPRESSOR__STAGE", "mlp")]),
    Variant::oracle("code-6", "codes of 6", &[("COMPRESSOR__CODE_SIZE", "6")]),
    Variant::oracle("code-3", "codes of 3", &[("COMPRESSOR__CODE_SIZE", "3")]),
    Variant::oracle("one-stage", "no online stage", &[("COMPRESSOR__CODE_SIZE", "32")]),
    Variant {
        encoder: Encoder::Bundle,
        ..Variant::oracle("bundle", "the bundle's networks and not the true classes", &[])
    },
    Variant {
        encoder: Encoder::Bundle,
        ..Variant::oracle(
            "no-srd",
            "the same, coarse features stretched",
            &[("LANGUAGE__SRD", "false")],
        )
    },
    Variant::oracle(
        "paper-tracker",
        "Adam on pictures of the map",
        &[("TRACKER__METHOD", "photometric")],
    ),
];

impl Variant {
    const fn oracle(
        name: &'static str,
        about: &'static str,
        settings: &'static [(&'static str, &'static str)],
    ) -> Self {
        Self { name, about, settings, encoder: Encoder::Oracle }
    }
}

fn names() -> Vec<&'static str> {
    VARIANTS.iter().map(|variant| variant.name).collect()
}

/// Runs the command.
pub async fn run(arguments: &Ablate) -> Result<()> {
    let stride = arguments.stride;
    let end = arguments.frames.map(|frames| frames.get().saturating_mul(stride.get()));
    let dataset: Arc<dyn Dataset> = Arc::from(arguments.sensing.open(
        &arguments.dataset,
        FrameRange { end, stride, ..FrameRange::default() },
        Poses::Estimate,
    )?);
    if dataset.truth().is_none() {
        bail!("{} has no masks, so language cannot be scored: choose another", arguments.dataset);
    }
    let is_wanted = |variant: &&Variant| {
        arguments.only.is_empty() || arguments.only.iter().any(|name| name == variant.name)
    };
    let wanted: Vec<&Variant> = VARIANTS.iter().filter(is_wanted).collect();
    let mut measured = Vec::new();
    for (at, variant) in wanted.iter().enumerate() {
        note!("{} of {}: {} ({})", at + 1, wanted.len(), variant.name, variant.about);
        measured.push((*variant, one(arguments, &dataset, variant).await?));
    }
    let (columns, rows) = (columns(), rows(&measured));
    say_part!("{}", table(&columns, &rows))?;
    let page = arguments.out.join("ablation.md");
    save(&page, markdown(&measured[0].1, &columns, &rows))?;
    say!("\nreport     {}", page.display())?;
    Ok(())
}

async fn one(arguments: &Ablate, dataset: &Arc<dyn Dataset>, variant: &Variant) -> Result<Report> {
    let out = arguments.out.join(variant.name);
    make_folder(&out)?;
    let plan = Plan {
        program: arguments.server.clone().map_or_else(beside_this, Ok)?,
        config: None,
        models: arguments.models.clone(),
        settings: variant.settings.to_vec(),
        log: out.join("server.log"),
    };
    let options = Options {
        poses: Poses::Estimate,
        encoder: variant.encoder,
        hold_out_every: None,
        converged: false,
        labels: Some(LabelSource::Masks),
        lpips: None,
    };
    let evaluation = measure_own(plan, dataset.clone(), None, options).await?;
    write(&out, &evaluation)?;
    Ok(evaluation.report)
}

fn columns() -> [Column<'static>; 9] {
    let names =
        ["variant", "PSNR, dB", "SSIM", "ATE, cm", "mIoU", "Loc", "AP", "s/frame", "what it is"];
    names.map(|name| match name {
        "variant" | "what it is" => Column::left(name),
        _ => Column::right(name),
    })
}

fn rows(measured: &[(&Variant, Report)]) -> Vec<Vec<String>> {
    let number = |value: Option<f64>, digits: usize| match value {
        Some(value) => format!("{value:.digits$}"),
        None => "-".to_owned(),
    };
    let row = |(variant, report): &(&Variant, Report)| {
        let masks = report.language.as_ref().and_then(|language| language.scene.masks);
        let precision = masks.map(|masks| masks.average_precision);
        vec![
            variant.name.to_owned(),
            number(report.psnr_db, 2),
            number(report.ssim, 4),
            number(report.ate_rmse_cm, 3),
            number(report.miou, 3),
            number(report.loc_accuracy, 3),
            number(precision, 3),
            number(Some(report.seconds_per_frame_settled), 3),
            variant.about.to_owned(),
        ]
    };
    measured.iter().map(row).collect()
}

fn markdown(report: &Report, columns: &[Column<'_>], rows: &[Vec<String>]) -> String {
    format!(
        "# {}: {} frames, poses estimated, {}\n\nEach variant is the default with one thing changed; \
         language is the true classes' names per pixel unless said otherwise. PSNR and SSIM of \
         held-out views, mIoU at 0.5, seconds per frame with all work done.\n\n{}",
        report.dataset,
        report.frames,
        report.adapter,
        markdown_table(columns, rows)
    )
}
