//! The evaluation itself: streams, waits until the map is settled, and measures.

use crate::context::Context;
use crate::error::EvaluateError;
use crate::options::{Options, Target};
use crate::recorded::Recorded;
use crate::report::{Measured, Report};
use crate::samples::{self, Sample};
use crate::selection::Selection;
use crate::stages;
use crate::step::Step;
use crate::trajectory::{StampedPose, align, ate, paired, read_tum};
use crate::{views, words};
use lexsplat_client::dataset::Dataset;
use lexsplat_client::http::{HttpClient, HttpError};
use lexsplat_client::stream::{Poses, Progress, StreamOptions, stream};
use nalgebra::Isometry3;
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

/// Streams, waits, measures.
///
/// # Errors
/// [`EvaluateError`]; wrong answers are measured, not errors.
pub async fn evaluate(
    dataset: Arc<dyn Dataset>,
    target: &Target,
    mut options: Options,
    mut on_step: impl FnMut(Step<'_>),
) -> Result<Evaluation, EvaluateError> {
    let client = HttpClient::new(&target.http)?;
    refuse_old_map(&client, &target.map).await?;
    let health = client.health().await?;
    let before = client.metrics().await?;
    let recorded = Arc::new(Recorded::new(dataset));
    let streaming = StreamOptions {
        grpc: target.grpc.clone(),
        map: target.map.clone(),
        poses: options.poses,
        encoder: options.encoder,
        hold_out_every: options.hold_out_every,
        realtime: false,
    };
    let on_progress = |progress: &Progress| on_step(Step::Streaming(progress));
    let summary = stream(recorded.clone(), &streaming, on_progress).await?;
    let streamed = Instant::now();
    let status = client.settled(&target.map, |status| on_step(Step::Settling(status))).await?;
    let settle_seconds = streamed.elapsed().as_secs_f64();
    if summary.tracked == 0 {
        let reason = summary.refusals.first().map_or("all are lost", |first| &first.reason).into();
        return Err(EvaluateError::NothingTracked { sent: summary.sent, reason });
    }
    let after = client.metrics().await?;

    let trajectory_tum =
        String::from_utf8_lossy(&client.trajectory(&target.map).await?).into_owned();
    let estimate = read_tum(&trajectory_tum).map_err(|reason| EvaluateError::Answer { reason })?;
    let seen = recorded.seen();
    let truth: Vec<StampedPose> = seen.iter().filter_map(|frame| frame.truth).collect();
    let trajectory = paired(&estimate, &truth);

    let context = Context { client: &client, map: &target.map, dataset: &*recorded };
    let selection = Selection::of(&seen, &estimate, &summary, options.hold_out_every);
    let lpips = options.lpips.take();
    let views = views::score(&context, &selection.views(), lpips, &mut on_step).await?;
    let words = match context.dataset.truth().filter(|_| options.language) {
        Some(truth) => {
            // Poses that were given are in the true world already.
            let truth_from_map = match options.poses {
                Poses::Given => Isometry3::identity(),
                Poses::Estimate => align(&trajectory),
            };
            Some(words::score(&context, truth, &selection, &truth_from_map, &mut on_step).await?)
        }
        None => None,
    };
    let language = words.as_ref().map(|words| &words.language);
    let samples = samples::take(&context, &views, language, &seen).await?;
    // The server's highest mark is that of all its work, the questions included.
    let peak_rss_bytes = stages::peak_memory(&client.metrics().await?);
    let report = Report::new(Measured {
        dataset: context.dataset,
        options,
        health,
        summary,
        status,
        settle_seconds,
        peak_rss_bytes,
        ate: ate(&trajectory),
        views,
        words,
        stages: stages::between(&before, &after),
    });
    Ok(Evaluation { report, trajectory, trajectory_tum, samples })
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
