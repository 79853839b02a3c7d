//! A checkpoint: the whole state of a map, from which it goes on exactly as if it had never stopped.
//!
//! In: what the map's thread copied between two pieces of work. Out: records of
//! [MessagePack](https://msgpack.org) with named fields, so that a field that is missing or of another type
//! is an error. The first record has all that is small, the second the Gaussians with the moments of the
//! optimiser; then comes one for each keyframe. Files, checksums and compression are not known here.

use super::closure::Detection;
use super::frame::Frame;
use super::frame_times::FrameTimes;
use super::input_check::InputCheck;
use super::input_warning::InputWarning;
use super::keyframes::KeyframeState;
use super::live_map::LiveState;
use super::saving::packed;
use super::tracker::TrackerState;
use lexsplat_gpu::SavedGaussians;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::io::{Read, Write};

/// Version of the records. It is increased when they mean something else.
pub const VERSION: u32 = 7;

/// Why a checkpoint cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The medium failed.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A record cannot be written.
    #[error("a part of the map cannot be written: {0}")]
    Encode(#[from] rmp_serde::encode::Error),
    /// A record is not what it should be.
    #[error("a record cannot be read: {0}")]
    Decode(#[from] rmp_serde::decode::Error),
    /// A record is shorter than it says, or something follows the last one.
    #[error("the checkpoint is not complete")]
    Incomplete,
}

/// The state of one map after a certain frame.
pub struct Checkpoint {
    pub(super) core: Core,
    pub(super) gaussians: SavedGaussians,
    pub(super) keyframes: Vec<KeyframeState>,
}

/// What is neither a Gaussian nor a keyframe.
#[derive(Serialize, Deserialize)]
pub(super) struct Core {
    pub progress: Progress,
    pub live: LiveState,
    pub tracker: TrackerState,
    pub detection: Detection,
    pub input_check: InputCheck,
    /// Keyframes without language, in the order in which they were given to the networks.
    pub waiting_for_language: Vec<Frame>,
    /// Sizes of the trainer's lists.
    pub hit_capacities: [usize; 2],
    /// Keyframes that follow.
    pub keyframes: usize,
}

/// How far a map has come, and what it has told.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Progress {
    /// Sequence number of the newest frame that the map knows.
    pub through: Option<u64>,
    /// Id of the stream that sent it.
    pub stream: u64,
    /// The times of the map's frames up to it.
    pub times: FrameTimes,
    pub frames_tracked: u64,
    pub frames_lost: u64,
    pub frames_refused: u64,
    pub input_warnings: Vec<InputWarning>,
    /// Number of the next event.
    pub next_event: u64,
}

#[derive(Serialize, Deserialize)]
struct GaussianRecord {
    len: usize,
    channels: usize,
    owner: u32,
    #[serde(with = "packed")]
    bytes: Vec<u8>,
}

impl Checkpoint {
    /// Sequence number of the newest frame in it; `None` if the map had no frame.
    pub fn through(&self) -> Option<u64> {
        self.core.progress.through
    }

    /// Frames in it, tracked or lost.
    pub fn frames(&self) -> u64 {
        self.core.progress.frames_tracked + self.core.progress.frames_lost
    }

    /// Writes all records.
    ///
    /// # Errors
    /// [`CheckpointError::Io`], [`CheckpointError::Encode`].
    pub fn write(self, out: &mut impl Write) -> Result<(), CheckpointError> {
        put(out, &self.core)?;
        let SavedGaussians { len, channels, owner, bytes } = self.gaussians;
        put(out, &GaussianRecord { len, channels, owner, bytes })?;
        self.keyframes.iter().try_for_each(|keyframe| put(out, keyframe))
    }

    /// Reads what [`Checkpoint::write`] wrote, to the end.
    ///
    /// # Errors
    /// [`CheckpointError`].
    pub fn read(input: &mut impl Read) -> Result<Self, CheckpointError> {
        let core: Core = take(input)?;
        let GaussianRecord { len, channels, owner, bytes } = take(input)?;
        let gaussians = SavedGaussians { len, channels, owner, bytes };
        let keyframes = (0..core.keyframes).map(|_| take(input)).collect::<Result<_, _>>()?;
        if input.read(&mut [0])? > 0 {
            return Err(CheckpointError::Incomplete);
        }
        Ok(Self { core, gaussians, keyframes })
    }
}

/// Writes a record: its length in 8 bytes, then itself.
fn put(out: &mut impl Write, record: &impl Serialize) -> Result<(), CheckpointError> {
    let bytes = rmp_serde::to_vec_named(record)?;
    out.write_all(&(bytes.len() as u64).to_le_bytes())?;
    Ok(out.write_all(&bytes)?)
}

fn take<T: DeserializeOwned>(input: &mut impl Read) -> Result<T, CheckpointError> {
    let mut length = [0; 8];
    input.read_exact(&mut length)?;
    let length = u64::from_le_bytes(length);
    let mut bytes = Vec::new();
    // As much as there is: a damaged length must not take all memory.
    if input.take(length).read_to_end(&mut bytes)? as u64 != length {
        return Err(CheckpointError::Incomplete);
    }
    Ok(rmp_serde::from_slice(&bytes)?)
}
