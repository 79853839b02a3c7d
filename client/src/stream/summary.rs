//! Progress and outcome of a stream, counted from its acknowledgements.

use super::error::ClientError;
use lexsplat_proto::v1::{self, FrameAck, FrameStatus, InputProblem};
use serde::Serialize;
use std::time::Instant;

/// Refusals, and frames left out, that a summary lists in full.
const LISTED: usize = 5;

/// Progress of a stream, after each acknowledgement.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// Frames acknowledged in this stream.
    pub acknowledged: u64,
    /// Frames to send in this stream.
    pub total: u64,
    /// Status of the last acknowledged frame; `Opened` before the first.
    pub status: FrameStatus,
    /// Frames waiting in the map's queue.
    pub queue_depth: u32,
    /// Frames that fit in the map's queue.
    pub queue_capacity: u32,
    /// Frames acknowledged per second since the stream opened.
    pub frames_per_second: f64,
    /// What the server says for the first time is probably wrong with the frames.
    pub input_warnings: Vec<InputWarning>,
}

/// What is probably wrong with the frames of a stream. They are mapped all the same.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct InputWarning {
    /// Number of the frame with which the server noticed it.
    pub sequence: u64,
    /// `depth_unit`, `inverted_poses`, `camera_axes`, `unregistered_depth`, `repeated_depth`,
    /// `bad_beginning` or `no_depth`.
    pub problem: String,
    /// What is wrong, how sure that is, and what to do.
    pub message: String,
}

impl InputWarning {
    /// The warnings of an acknowledgement.
    fn of(ack: &FrameAck) -> Vec<Self> {
        let warning = |warning: &v1::InputWarning| Self {
            sequence: ack.sequence,
            problem: problem_name(warning.problem()).into(),
            message: warning.message.clone(),
        };
        ack.input_warnings.iter().map(warning).collect()
    }
}

/// The name of a problem, the same as over HTTP.
fn problem_name(problem: InputProblem) -> &'static str {
    match problem {
        InputProblem::Unspecified => "unspecified",
        InputProblem::DepthUnit => "depth_unit",
        InputProblem::InvertedPoses => "inverted_poses",
        InputProblem::CameraAxes => "camera_axes",
        InputProblem::UnregisteredDepth => "unregistered_depth",
        InputProblem::RepeatedDepth => "repeated_depth",
        InputProblem::BadBeginning => "bad_beginning",
        InputProblem::NoDepth => "no_depth",
    }
}

/// A frame that the server refused.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Refusal {
    /// Number of the frame.
    pub sequence: u64,
    /// The field at fault.
    pub field: String,
    /// What is wrong with it.
    pub reason: String,
}

/// A frame that was not sent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Number of the frame.
    pub sequence: u64,
    /// What is wrong with its files.
    pub reason: String,
}

/// The outcome of a stream.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Name of the map.
    pub map: String,
    /// Frames that were not sent because the map had them already.
    pub resumed_past: u64,
    /// Frames sent and acknowledged.
    pub sent: u64,
    /// Sent frames with a pose.
    pub tracked: u64,
    /// Sent frames without a pose: tracking failed.
    pub lost: u64,
    /// Sent frames that the server refused.
    pub refused: u64,
    /// The first refused frames, with reasons.
    pub refusals: Vec<Refusal>,
    /// Frames that were not sent because they could not be read.
    pub left_out: u64,
    /// The first frames left out, with reasons.
    pub left_out_frames: Vec<LeftOut>,
    /// What is probably wrong with the frames, each problem once.
    pub input_warnings: Vec<InputWarning>,
    /// Numbers of the frames that became keyframes.
    pub keyframes: Vec<u64>,
    /// Seconds from the opening of the stream to the last acknowledgement.
    pub seconds: f64,
    /// Frames sent per second.
    pub frames_per_second: f64,
    /// Frames up to this number survive a crash of the server; absent if none does.
    pub durable_through: Option<u64>,
    /// The map's revision after the last frame.
    pub map_revision: u64,
}

/// Counts acknowledgements.
pub(super) struct Tally {
    pub summary: Summary,
    pub total: u64,
    started: Instant,
}

impl Tally {
    pub fn new(map: &str, opened: &FrameAck, all: usize, to_send: usize) -> Self {
        let summary = Summary {
            map: map.into(),
            resumed_past: (all - to_send) as u64,
            durable_through: opened.durable_through,
            map_revision: opened.map_revision,
            ..Summary::default()
        };
        Self { summary, total: to_send as u64, started: Instant::now() }
    }

    pub fn count(&mut self, ack: &FrameAck) {
        let summary = &mut self.summary;
        summary.sent += 1;
        match ack.status() {
            FrameStatus::Tracked | FrameStatus::Relocalised => summary.tracked += 1,
            FrameStatus::Refused => {
                summary.refused += 1;
                if summary.refusals.len() < LISTED {
                    summary.refusals.push(Refusal {
                        sequence: ack.sequence,
                        field: ack.refused_field.clone(),
                        reason: ack.refused_reason.clone(),
                    });
                }
            }
            FrameStatus::Lost | FrameStatus::Opened | FrameStatus::Unspecified => summary.lost += 1,
        }
        summary.input_warnings.extend(InputWarning::of(ack));
        if ack.keyframe {
            summary.keyframes.push(ack.sequence);
        }
        summary.durable_through = ack.durable_through.max(summary.durable_through);
        summary.map_revision = ack.map_revision;
        summary.seconds = self.started.elapsed().as_secs_f64();
        summary.frames_per_second = summary.sent as f64 / summary.seconds.max(f64::MIN_POSITIVE);
    }

    /// Counts frames that were not sent.
    pub fn leave_out(&mut self, frames: &[(u64, ClientError)]) {
        self.summary.left_out = frames.len() as u64;
        let told = |(sequence, error): &(u64, ClientError)| {
            let reason = match error {
                ClientError::Dataset(error) => error.whole(),
                other => other.to_string(),
            };
            LeftOut { sequence: *sequence, reason }
        };
        self.summary.left_out_frames = frames.iter().take(LISTED).map(told).collect();
    }

    pub fn progress(&self, ack: &FrameAck) -> Progress {
        Progress {
            acknowledged: self.summary.sent,
            total: self.total,
            status: ack.status(),
            queue_depth: ack.queue_depth,
            queue_capacity: ack.queue_capacity,
            frames_per_second: self.summary.frames_per_second,
            input_warnings: InputWarning::of(ack),
        }
    }
}
