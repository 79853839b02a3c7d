//! The evaluation itself: streams, waits until the map is settled, or has converged, and measures.

use crate::context::Context;
use crate::error::EvaluateError;
use crate::labels::{LabelSource, Labels};
use crate::options::{Options, Target};
use crate::probe::{self, Probe, ProbeTimes};
use crate::process::processor_seconds;
use crate::recorded::Recorded;
use crate::report::{Measured, Refined, Report};
use crate::samples::{self, Sample};
use crate::selection::Selection;
use crate::stages::{self, Stage};
use crate::step::Step;
use crate::trajectory::{StampedPose, align, ate, paired, read_tum};
use crate::words::LanguageScores;
use crate::{views, words};
use lexsplat_client::dataset::Dataset;
use lexsplat_client::http::{HttpClient, HttpError, Status};
use lexsplat_client::stream::{Poses, Progress, StreamOptions, Summary, stream};
use nalgebra::Isometry3;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// The result of an evaluation.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// All numbers.
    pub report: Report,
    /// Estimated and true pose of each frame that has both, in the data set's order.
    pub trajectory: Vec<[StampedPose; 2]>,
    /// The estimated trajectory as TUM text.
    pub trajectory_tum: String,
    /// A few images to look at: target, render and heat map.
    pub samples: Vec<Sample>,
}

/// Streams the data set, waits until the map is settled, and measures.
///
/// # Errors
/// [`EvaluateError`]. Wrong answers are no errors: they are scored.
pub async fn evaluate(
    dataset: Arc<dyn Dataset>,
    target: &Target,
    mut options: Options,
    mut on_step: impl FnMut(Step<'_>),
) -> Result<Evaluation, EvaluateError> {
    let client = HttpClient::with_access(&target.http, &target.access)?;
    refuse_old_map(&client, &target.map).await?;
    let health = client.health().await?;
    let recorded = Arc::new(Recorded::new(dataset));
    let probed_before = probe_of(target, &mut on_step);
    let mut mapped = make_map(&client, recorded.clone(), target, &options, &mut on_step).await?;

    let refined = refine(&client, target, &options, &mut mapped, &mut on_step).await?;
    let trajectory_tum =
        String::from_utf8_lossy(&client.trajectory(&target.map).await?.bytes).into_owned();
    let estimate = read_tum(&trajectory_tum).map_err(|reason| EvaluateError::Answer { reason })?;
    let seen = recorded.seen();
    let truth: Vec<StampedPose> = seen.iter().filter_map(|frame| frame.truth).collect();
    let trajectory = paired(&estimate, &truth);

    let context = Context { client: &client, map: &target.map, dataset: &*recorded };
    let selection = Selection::of(&seen, &estimate, &mapped.summary, options.hold_out_every);
    let lpips = options.lpips.take();
    let views = views::score(&context, &selection.views(), lpips, &mut on_step).await?;
    // A map of given poses is in the data set's world already.
    let truth_from_map = match options.poses {
        Poses::Given => Isometry3::identity(),
        Poses::Estimate => align(&trajectory),
    };
    let source = options.labels.take();
    let words =
        score_words(&context, source.as_ref(), &selection, truth_from_map, &mut on_step).await?;
    let language = words.as_ref().map(|words| &words.language);
    let samples = samples::take(&context, &views, language, &seen).await?;
    // The peak is taken last, so that it includes the queries.
    let peak_rss_bytes = stages::peak_memory(&client.metrics().await?);
    let probed_after = probe_of(target, &mut on_step);
    let report = Report::new(Measured {
        dataset: context.dataset,
        options,
        health,
        summary: mapped.summary,
        status: mapped.status,
        settle_seconds: mapped.settle_seconds,
        refined,
        peak_rss_bytes,
        ate: ate(&trajectory),
        views,
        words,
        stages: mapped.stages,
        processor_seconds: mapped.processor_seconds,
        probe: probed_before.zip(probed_after).map(|(before, after)| Probe::new(before, after)),
    });
    Ok(Evaluation { report, trajectory, trajectory_tum, samples })
}

/// Scores the labels of a source; `None` without labels. `truth_from_map` aligns the map with the data set.
async fn score_words(
    context: &Context<'_>,
    source: Option<&LabelSource>,
    selection: &Selection,
    truth_from_map: Isometry3<f64>,
    on_step: &mut impl FnMut(Step<'_>),
) -> Result<Option<LanguageScores>, EvaluateError> {
    let Some(source) = source else { return Ok(None) };
    let dataset = context.dataset;
    let labels = Labels::of(source, dataset, &selection.tracked, selection.unseen())?;
    Ok(match &labels {
        Some(labels) => Some(words::score(context, labels, &truth_from_map, on_step).await?),
        None => None,
    })
}

/// A settled map.
struct Mapped {
    summary: Summary,
    status: Status,
    settle_seconds: f64,
    stages: BTreeMap<String, Stage>,
    processor_seconds: Option<f64>,
}

/// The probe of this machine, if the server runs on it; it blocks for a second, as scoring does.
fn probe_of(target: &Target, on_step: &mut impl FnMut(Step<'_>)) -> Option<ProbeTimes> {
    if !target.is_here() {
        return None;
    }
    on_step(Step::Probing);
    Some(probe::measure())
}

/// Streams the data set and waits until the map is settled.
async fn make_map(
    client: &HttpClient,
    dataset: Arc<dyn Dataset>,
    target: &Target,
    options: &Options,
    on_step: &mut impl FnMut(Step<'_>),
) -> Result<Mapped, EvaluateError> {
    let before = client.metrics().await?;
    let processor = || target.process.and_then(processor_seconds);
    let processor_before = processor();
    let streaming = StreamOptions {
        grpc: target.grpc.clone(),
        access: target.access.clone(),
        map: target.map.clone(),
        poses: options.poses,
        encoder: options.encoder,
        hold_out_every: options.hold_out_every,
        realtime: false,
    };
    let on_progress = |progress: &Progress| on_step(Step::Streaming(progress));
    let summary = stream(dataset, &streaming, on_progress).await?;
    let streamed = Instant::now();
    let status = client.settled(&target.map, |status| on_step(Step::Settling(status))).await?;
    let settle_seconds = streamed.elapsed().as_secs_f64();
    let processor_seconds = processor_before.zip(processor()).map(|(before, after)| after - before);
    if summary.tracked == 0 {
        let reason = summary.refusals.first().map_or("all are lost", |first| &first.reason).into();
        return Err(EvaluateError::NothingTracked { sent: summary.sent, reason });
    }
    let stages = stages::between(&before, &client.metrics().await?);
    Ok(Mapped { summary, status, settle_seconds, stages, processor_seconds })
}

/// Waits until the map has converged, if it is to be measured then.
async fn refine(
    client: &HttpClient,
    target: &Target,
    options: &Options,
    mapped: &mut Mapped,
    on_step: &mut impl FnMut(Step<'_>),
) -> Result<Option<Refined>, EvaluateError> {
    if !options.converged {
        return Ok(None);
    }
    let processor = || target.process.and_then(processor_seconds);
    let (began, before) = (Instant::now(), processor());
    let on_status = |status: &Status| on_step(Step::Settling(status));
    mapped.status = client.converged(&target.map, on_status).await?;
    let processor_seconds = before.zip(processor()).map(|(before, after)| after - before);
    Ok(Some(Refined { seconds: began.elapsed().as_secs_f64(), processor_seconds }))
}

/// Refuses a map that has frames already: the scores would include them.
async fn refuse_old_map(client: &HttpClient, map: &str) -> Result<(), EvaluateError> {
    const NOT_FOUND: u16 = 404;
    match client.status(map).await {
        Ok(status) if status.frames_received > 0 => {
            Err(EvaluateError::MapInUse { map: map.into(), frames: status.frames_received })
        }
        Ok(_) | Err(HttpError::Refused { status: NOT_FOUND, .. }) => Ok(()),
        Err(error) => Err(error.into()),
    }
}
