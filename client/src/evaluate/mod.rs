//! **Evaluation**: streams a data set to a server, waits until its map is settled and measures what the
//! paper measures: speed, trajectory, pictures, language.
//!
//! In: a [`Dataset`], a running server ([`Target`]), what to measure ([`Options`]). Out: an
//! [`Evaluation`] with the [`Report`], the trajectories for plots and some pictures. It writes no
//! file and starts no server; it asks the server as every client does.

mod clouds;
mod language;
mod perceptual;
mod picture;
mod presence;
mod recorded;
mod report;
mod samples;
mod score;
mod space;
mod stages;
mod trajectory;
mod views;

pub mod plot;

pub use clouds::{Point, chamfer, earth_movers, resampled};
pub use language::{ClassScore, LabelMeans, LabelScore, Language, Latency};
pub use perceptual::{Lpips, LpipsError};
pub use picture::{DepthError, depth_error, psnr_db, ssim};
pub use presence::{Bin, Fitted, Judgement, Presence, Reliability};
pub use report::{Report, Row};
pub use samples::Sample;
pub use score::{Bounds, Plane, as_released, average_precision, boxes, iou};
pub use space::{CountScore, Space, SpaceMeans, SpaceScore};
pub use stages::Stage;
pub use trajectory::{Ate, StampedPose, align, ate, paired, read_tum};
pub use views::{HELD_OUT_EVERY, ViewMeans, ViewScore};

use crate::dataset::{Dataset, DatasetError, Truth};
use crate::http::{Answer, HttpClient, HttpError, Question, Status};
use crate::stream::{ClientError, Encoder, Poses, Progress, StreamOptions, Summary, stream};
use image::{DynamicImage, RgbImage};
use nalgebra::Isometry3;
use recorded::{Recorded, Seen};
use report::Measured;
use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Which server, and which of its maps; the map must be new.
#[derive(Clone, Debug)]
pub struct Target {
    /// Where it takes frames, `HOST:PORT`.
    pub grpc: String,
    /// Where it answers, `HOST:PORT`.
    pub http: String,
    /// The map to be made.
    pub map: String,
}

/// What to measure.
#[derive(Debug)]
pub struct Options {
    /// Where the map's poses come from.
    pub poses: Poses,
    /// Where the map's language comes from.
    pub encoder: Encoder,
    /// Every so many frames one is only tracked, and the pictures are scored on these. `None`: none is,
    /// and they are scored on every [`HELD_OUT_EVERY`]-th tracked frame that is no keyframe.
    pub hold_out_every: Option<NonZeroUsize>,
    /// Whether words are asked, if the data set has masks.
    pub language: bool,
    /// What says how different pictures look; `None`: nobody is asked.
    pub lpips: Option<Lpips>,
}

/// How far an evaluation is.
#[derive(Clone, Copy, Debug)]
pub enum Step<'a> {
    /// Frames are sent.
    Streaming(&'a Progress),
    /// The map works on what it has.
    Settling(&'a Status),
    /// Frames are rendered and compared.
    Rendering {
        /// So many.
        done: usize,
        /// Of so many.
        of: usize,
    },
    /// Words are asked about the whole map.
    Locating {
        /// So many.
        done: usize,
        /// Of so many.
        of: usize,
    },
    /// Words are asked that are not there.
    Judging {
        /// In so many views.
        done: usize,
        /// Of so many.
        of: usize,
    },
    /// Words are asked about frames.
    Asking {
        /// About so many.
        done: usize,
        /// Of so many.
        of: usize,
    },
}

/// What was measured.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// In numbers.
    pub report: Report,
    /// Estimate and truth of the frames that have both, in the data set's order.
    pub trajectory: Vec<[StampedPose; 2]>,
    /// The server's TUM text.
    pub trajectory_tum: String,
    /// Target, render and heat map of a few answers.
    pub samples: Vec<Sample>,
}

/// Why there is no evaluation.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// The stream broke.
    #[error(transparent)]
    Stream(#[from] ClientError),
    /// The server gave no answer.
    #[error(transparent)]
    Http(#[from] HttpError),
    /// The data set cannot be read.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The map has been there before.
    #[error("map {map:?} is there already with {frames} frames: name a new one with --map")]
    MapInUse {
        /// The map.
        map: String,
        /// Frames in it.
        frames: u64,
    },
    /// Nothing to measure.
    #[error("none of {sent} frames is in the map: {reason}")]
    NothingTracked {
        /// Frames sent.
        sent: u64,
        /// The first refusal, if there is one.
        reason: String,
    },
    /// A picture of another size.
    #[error("frame {sequence}: expected a picture of {expected:?}, found {found:?}")]
    Size {
        /// The frame.
        sequence: u64,
        /// Columns and rows of the frame.
        expected: (u32, u32),
        /// Of what the server rendered.
        found: (u32, u32),
    },
    /// Pictures cannot be compared by the network.
    #[error(transparent)]
    Lpips(#[from] LpipsError),
    /// A picture that cannot be decoded.
    #[error("frame {sequence}: a picture cannot be decoded")]
    Picture {
        /// The frame.
        sequence: u64,
        /// Why.
        source: image::ImageError,
    },
    /// The trajectory is no TUM text, or an answer lacks its heat map.
    #[error("the server answered badly: {reason}")]
    Answer {
        /// What is wrong with it.
        reason: String,
    },
}

/// A map that is measured.
struct Context<'a> {
    client: &'a HttpClient,
    map: &'a str,
    dataset: &'a dyn Dataset,
}

impl Context<'_> {
    /// What the map shows from a frame.
    async fn render(&self, sequence: u64) -> Result<RgbImage, EvaluateError> {
        let file = self.client.render_png(self.map, sequence).await?;
        Ok(decoded(&file, sequence)?.to_rgb8())
    }

    /// The answer for a frame, its unsmoothed relevancies, and how long the answer took.
    async fn relevancy(
        &self,
        text: &str,
        frame: u64,
    ) -> Result<(Answer, Plane, Duration), EvaluateError> {
        let question = Question { smoothing: Some(0), ..Question::in_frame(text, frame) };
        let asked = Instant::now();
        let answer = self.client.query(self.map, &question).await?;
        let took = asked.elapsed();
        let missing = || EvaluateError::Answer { reason: format!("{text:?} has no heat map") };
        let (array, _) = self.client.heatmap(answer.heatmap.as_ref().ok_or_else(missing)?).await?;
        Ok((answer, Plane { width: array.shape[1], values: array.values }, took))
    }
}

fn decoded(file: &[u8], sequence: u64) -> Result<DynamicImage, EvaluateError> {
    image::load_from_memory(file).map_err(|source| EvaluateError::Picture { sequence, source })
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
    let chosen = Chosen::of(&seen, &estimate, &summary, options.hold_out_every);
    let lpips = options.lpips.take();
    let views = views::score(&context, &chosen.views(), lpips, &mut on_step).await?;
    let words = match context.dataset.truth().filter(|_| options.language) {
        Some(truth) => {
            // Poses that were given are in the true world already.
            let truth_from_map = match options.poses {
                Poses::Given => Isometry3::identity(),
                Poses::Estimate => align(&trajectory),
            };
            Some(ask_words(&context, truth, &chosen, &truth_from_map, &mut on_step).await?)
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

/// Everything that was measured with words.
struct Words {
    language: Language,
    space: Space,
    presence: Presence,
}

async fn ask_words(
    context: &Context<'_>,
    truth: &dyn Truth,
    chosen: &Chosen,
    truth_from_map: &Isometry3<f64>,
    on_step: &mut impl FnMut(Step<'_>),
) -> Result<Words, EvaluateError> {
    let counted: Vec<usize> =
        chosen.tracked.iter().copied().step_by(language::COUNTED_EVERY).collect();
    let labels = language::most_visible(truth, &counted)?;
    let frames = chosen.test_frames();
    let language = language::score(context, truth, &labels, &frames, on_step).await?;
    let (space, mut judgements) =
        space::score(context, truth, &labels, truth_from_map, on_step).await?;
    judgements.extend(presence::ask(context, truth, &labels, &frames, on_step).await?);
    Ok(Words { language, space, presence: Presence::of(judgements, &labels) })
}

/// A map that has frames already would be measured with what others did to it.
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

/// Positions of frames in the data set.
struct Chosen {
    tracked: Vec<usize>,
    keyframes: Vec<usize>,
    others: Vec<usize>,
    /// Frames that nothing in the map was made of, to be rendered.
    held_out: Vec<usize>,
}

impl Chosen {
    fn of(
        seen: &[Seen],
        estimate: &[StampedPose],
        summary: &Summary,
        hold_out_every: Option<NonZeroUsize>,
    ) -> Self {
        let times: BTreeSet<u64> = estimate.iter().map(|pose| pose.nanos).collect();
        let keys: BTreeSet<u64> = summary.keyframes.iter().copied().collect();
        let tracked: Vec<&Seen> = seen.iter().filter(|seen| times.contains(&seen.nanos)).collect();
        let (keyframes, others): (Vec<&Seen>, Vec<&Seen>) =
            tracked.iter().partition(|seen| keys.contains(&seen.sequence));
        let indices = |frames: Vec<&Seen>| -> Vec<usize> {
            frames.into_iter().map(|seen| seen.index).collect()
        };
        let others = indices(others);
        let held_out = match hold_out_every {
            Some(every) => {
                let is_held_out = |index: &usize| (index + 1).is_multiple_of(every.get());
                others.iter().copied().filter(is_held_out).collect()
            }
            None => others.iter().copied().step_by(HELD_OUT_EVERY).collect(),
        };
        Self { tracked: indices(tracked), keyframes: indices(keyframes), others, held_out }
    }

    /// Frames to render, in order, and whether each is a keyframe.
    fn views(&self) -> Vec<(usize, bool)> {
        let held_out = self.held_out.iter().map(|index| (*index, false));
        let mut views: Vec<_> =
            held_out.chain(self.keyframes.iter().map(|index| (*index, true))).collect();
        views.sort_unstable();
        views
    }

    /// Frames to ask about; keyframes only if there is nothing else.
    fn test_frames(&self) -> Vec<usize> {
        let of = if self.others.is_empty() { &self.tracked } else { &self.others };
        language::spread(of, language::TEST_FRAMES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn held_out_frames_are_tracked_and_no_keyframes() {
        let pose = |nanos| StampedPose { nanos, world_from_camera: Isometry3::identity() };
        let seen: Vec<Seen> = (0..20)
            .map(|i| Seen { index: i, sequence: 100 + i as u64, nanos: i as u64, truth: None })
            .collect();
        // Frame 3 is lost, 0 and 10 are keyframes.
        let estimate: Vec<StampedPose> = (0..20).filter(|i| *i != 3).map(pose).collect();
        let summary = Summary { keyframes: vec![100, 110], ..Summary::default() };
        let chosen = Chosen::of(&seen, &estimate, &summary, None);
        assert_eq!(chosen.tracked.len(), 19);
        let views = chosen.views();
        let held_out: Vec<usize> = views.iter().filter(|view| !view.1).map(|view| view.0).collect();
        assert_eq!(held_out, [1, 7, 13, 18]);
        assert_eq!(views.iter().filter(|view| view.1).count(), 2);
        assert!(!chosen.test_frames().contains(&3) && !chosen.test_frames().contains(&0));
        let every = NonZeroUsize::new(8);
        assert_eq!(Chosen::of(&seen, &estimate, &summary, every).held_out, [7, 15]);
        let only_keys = Chosen { others: Vec::new(), ..chosen };
        assert_eq!(only_keys.test_frames().len(), 19);
    }
}
