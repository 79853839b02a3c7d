//! Frames of a stream that go into a map of this server.

use super::destination::{Acked, Destination, Destinations};
use super::maps::wire_warnings;
use super::status;
use crate::check::{self, Limits, Opening, Refusal};
use crate::maps::{RecordedMaps, Recording};
use crate::pipeline::frame::{Frame, FrameOutcome, TrackingState};
use crate::telemetry::{REGISTRATION_SECONDS, timed};
use lexsplat_proto::v1::{self, FrameAck, FrameStatus};
use nalgebra::{Isometry3, Matrix6};
use std::time::Instant;
use tonic::Status;

impl Destinations for RecordedMaps {
    type One = Recording;

    async fn destination(&self, open: &v1::OpenMap) -> Result<Recording, Status> {
        self.open(open).await.map_err(|error| status::of_maps(&error, "map"))
    }
}

impl Destination for Recording {
    type Checked = Frame;

    fn received_through(&self) -> Option<u64> {
        self.map().received_through()
    }

    fn check(
        wire: &v1::Frame,
        opening: &Opening,
        newest: Option<u64>,
        limits: &Limits,
    ) -> Result<Frame, Refusal> {
        let raw = check::frame(wire, opening, newest, limits)?;
        timed(REGISTRATION_SECONDS, || check::registered(raw, opening))
    }

    /// Records a frame, then gives it to the mapper.
    async fn keep(&mut self, wire: v1::Frame, frame: Frame) -> Result<(Acked, Instant), Status> {
        let sequence = wire.sequence;
        self.record(wire).await.map_err(|error| {
            tracing::error!(%error, sequence, "a frame cannot be recorded");
            let reason = error.reason();
            Status::unavailable(format!(
                "frame {sequence} is not in the map, because it cannot be recorded: {reason}"
            ))
        })?;
        let since = Instant::now();
        let map = self.map().clone();
        let outcome = map.submit(frame).await.map_err(|error| status::of_map(&error, "map"))?;
        let acked = async move {
            let outcome = outcome.await.map_err(|_| {
                let reason = map.status().failure.unwrap_or_else(|| "it was stopped".into());
                Status::aborted(format!(
                    "map {:?} ended before frame {sequence} was handled: {reason}",
                    map.name()
                ))
            })?;
            Ok(outcome_ack(outcome))
        };
        Ok((Box::pin(acked), since))
    }

    fn count_refused(&self) {
        self.map().count_refused();
    }

    fn completer(&self) -> Box<dyn Fn(&mut FrameAck) + Send + Sync> {
        let (map, is_recorded) = (self.map().clone(), self.is_recorded());
        Box::new(move |ack| {
            if !matches!(
                ack.status(),
                FrameStatus::Tracked | FrameStatus::Relocalised | FrameStatus::Lost
            ) {
                ack.map_revision = map.status().revision;
            }
            // Frames are recorded before the map gets them.
            ack.durable_through = map.received_through().filter(|_| is_recorded);
            let (depth, capacity) = map.queue();
            ack.queue_depth = u32::try_from(depth).unwrap_or(u32::MAX);
            ack.queue_capacity = u32::try_from(capacity).unwrap_or(u32::MAX);
        })
    }

    async fn end(&mut self) {
        self.finish().await;
    }
}

/// The acknowledgement of a frame that was mapped.
pub(crate) fn outcome_ack(outcome: FrameOutcome) -> FrameAck {
    let status = match outcome.tracking {
        TrackingState::Tracking if outcome.relocalised => FrameStatus::Relocalised,
        TrackingState::Tracking => FrameStatus::Tracked,
        TrackingState::Lost | TrackingState::Empty => FrameStatus::Lost,
    };
    FrameAck {
        sequence: outcome.sequence,
        status: status.into(),
        world_from_camera: outcome.world_from_camera.as_ref().map(wire_pose),
        pose_covariance: outcome.covariance.map(row_major).unwrap_or_default(),
        keyframe: outcome.keyframe,
        map_revision: outcome.revision,
        input_warnings: wire_warnings(outcome.input_warnings),
        ..FrameAck::default()
    }
}

fn row_major(covariance: Matrix6<f64>) -> Vec<f64> {
    covariance.transpose().as_slice().to_vec()
}

fn wire_pose(target_from_source: &Isometry3<f64>) -> v1::Pose {
    let (q, t) = (target_from_source.rotation, target_from_source.translation);
    v1::Pose {
        rotation: Some(v1::Quaternion { w: q.w, x: q.i, y: q.j, z: q.k }),
        translation_metres: Some(v1::Vector3 { x: t.x, y: t.y, z: t.z }),
    }
}
