//! Measuring a data set, on a server of its own or on a running one, and writing the results.

use crate::files::{save, save_image};
use crate::progress::{progress_bar, show};
use crate::runtime::interrupted;
use crate::server::{Plan, Server};
use anyhow::{Context as _, Result, bail};
use indicatif::ProgressBar;
use lexsplat_client::Access;
use lexsplat_client::dataset::Dataset;
use lexsplat_client::stream::Encoder;
use lexsplat_evaluate::{Evaluation, Options, Step, Target, evaluate, markdown, plot};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The relevancy bias for features that are the true classes' names. Of the house's 39 classes each
/// has a margin of 0.75 to 1.0 to its own name, and of at most 0.6 to names of similar objects. A
/// relevancy of 0.5 lies in the middle, times the temperature of 10.
const ORACLE_BIAS: (&str, &str) = ("QUERY__BIAS", "5.1");

/// The setting that turns refinement off, and its key.
const NO_REFINEMENT: ((&str, &str), &str) = (("MAPPER__REFINE_SWEEPS", "0"), "refine_sweeps");

/// Measures on a server that is started for it and stopped afterwards. The map is called `map`, or
/// like the data set.
pub async fn measure_own(
    mut plan: Plan,
    dataset: Arc<dyn Dataset>,
    map: Option<String>,
    options: Options,
) -> Result<Evaluation> {
    if options.encoder == Encoder::Oracle {
        plan.settings.push(ORACLE_BIAS);
    }
    let mut settings = settings(&plan)?;
    // A map that goes on changing cannot be scored. Older builds do not refine.
    if !options.converged && settings.contains(NO_REFINEMENT.1) {
        plan.settings.push(NO_REFINEMENT.0);
        settings = self::settings(&plan)?;
    }
    let mut server = Server::start(&plan).await?;
    let (grpc, http) = (server.ready.grpc.clone(), server.ready.http.clone());
    let map = map.unwrap_or_else(|| dataset.name().to_owned());
    let process = Some(server.process());
    let target = Target { grpc, http, access: Access::default(), map, process };
    let mut evaluation = tokio::select! {
        done = measure(dataset, &target, options) => done.map_err(|error| server.explain(error))?,
        pressed = interrupted() => pressed.and_then(|()| bail!("interrupted"))?,
    };
    server.stop()?;
    evaluation.report.config = Some(settings);
    Ok(evaluation)
}

/// The settings that the server will use, as TOML.
///
/// # Errors
/// If it cannot be started, or refuses its settings.
pub fn settings(plan: &Plan) -> Result<String> {
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

/// Measures on the server of `target`.
pub async fn measure(
    dataset: Arc<dyn Dataset>,
    target: &Target,
    options: Options,
) -> Result<Evaluation> {
    let mut bars = Bars::new(dataset.len() as u64);
    let measured = evaluate(dataset, target, options, |step| bars.show(step)).await;
    bars.current.finish_and_clear();
    Ok(measured?)
}

/// A progress bar for each step, one after the other.
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
            Step::Probing => {
                self.begin("probing the machine", 0);
            }
            Step::Streaming(progress) => {
                show(self.begin("streaming", progress.total as usize), progress);
            }
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

/// Writes the report, plots and images into a folder; returns the path of report.md.
pub fn write(out: &Path, evaluation: &Evaluation) -> Result<PathBuf> {
    let Evaluation { report, trajectory, trajectory_tum, samples } = evaluation;
    let plots = [
        ("trajectory.png", "Trajectory from above", plot::trajectory(trajectory)),
        ("psnr.png", "PSNR over frames", plot::psnr(&report.views)),
        (
            "reliability.png",
            "Confidence and truth",
            report.presence.as_ref().and_then(plot::reliability),
        ),
        (
            "uncertainty.png",
            "Uncertainty and errors of pixels",
            report.uncertainty.as_ref().map(plot::uncertainty),
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
        save_image(&path, &picture)?;
        pictures.push((file, caption));
    }
    let page = out.join("report.md");
    let texts = [
        (out.join("report.json"), serde_json::to_string_pretty(report)?),
        (out.join("trajectory.tum"), trajectory_tum.clone()),
        (page.clone(), markdown(report, &pictures)),
    ];
    for (path, text) in texts {
        save(&path, text)?;
    }
    Ok(page)
}
