//! Events of a map: what its thread receives, and what its watchers are told.

use super::super::checkpoint::Checkpoint;
use super::super::encoder::LanguageMap;
use super::super::frame::{Frame, FrameOutcome};
use super::super::frame_times::FrameTimes;
use super::super::input_warning::InputWarning;
use super::status::Refinement;
use tokio::sync::{OwnedSemaphorePermit, oneshot};

/// An event for watchers.
#[derive(Clone, Debug)]
pub enum MapEvent {
    /// A frame was mapped or lost.
    Frame(Box<FrameOutcome>),
    /// The frames of a stream are probably wrong.
    InputWarning {
        /// The frame with which it was noticed.
        sequence: u64,
        /// What is wrong.
        warning: InputWarning,
    },
    /// The map has changed: readers can have a new snapshot.
    Revision {
        /// Its revision.
        revision: u64,
        /// Gaussians in it.
        gaussians: usize,
        /// Keyframes in it.
        keyframes: usize,
    },
    /// The refinement of the map begins, pauses or ends.
    Refinement(Refinement),
}

/// An event with its number.
#[derive(Clone, Debug)]
pub struct NumberedEvent {
    /// 1, 2, 3 … within a map; a gap means that events were missed.
    pub id: u64,
    /// The event.
    pub event: MapEvent,
}

/// A message to a map's thread.
pub(in super::super) enum Message {
    Frame {
        frame: Box<Frame>,
        /// Id of the stream that sent the frame: 1, 2, 3 … within a map.
        stream: u64,
        /// The map's times up to this frame.
        times: FrameTimes,
        /// The frame's place in the queue, given back when the thread takes the frame.
        permit: OwnedSemaphorePermit,
        reply: oneshot::Sender<FrameOutcome>,
    },
    /// The networks are done with a keyframe.
    Language {
        sequence: u64,
        map: Result<LanguageMap, String>,
    },
    /// The language thread's queue has room again.
    LanguageRoom,
    /// A reader wants a copy of the map as it is.
    CopyWanted,
    /// A reader waits until the map has converged.
    Refine,
    /// The whole state is wanted, as soon as the map can be continued from it exactly.
    Save(oneshot::Sender<Result<Checkpoint, String>>),
    Stop,
}
