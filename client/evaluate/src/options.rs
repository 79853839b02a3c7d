//! What is to be evaluated, and on which server.

use crate::lpips::Lpips;
use lexsplat_client::Access;
use lexsplat_client::stream::{Encoder, Poses};
use std::num::NonZeroUsize;

/// The server and the map to make there; a map of this name must not exist.
#[derive(Clone, Debug)]
pub struct Target {
    /// The server's gRPC address, `HOST:PORT`.
    pub grpc: String,
    /// The server's HTTP address, `HOST:PORT`.
    pub http: String,
    /// Token and certificates.
    pub access: Access,
    /// Name of the map.
    pub map: String,
}

/// What to measure.
#[derive(Debug)]
pub struct Options {
    /// Where the map's poses come from.
    pub poses: Poses,
    /// Where the map's language comes from.
    pub encoder: Encoder,
    /// Every N-th frame is held out: tracked, never a keyframe, and scored. `None`: every
    /// [`HELD_OUT_EVERY`](crate::HELD_OUT_EVERY)-th tracked frame that is no keyframe is scored.
    pub hold_out_every: Option<NonZeroUsize>,
    /// Whether queries are asked and scored, if the data set has masks.
    pub language: bool,
    /// The network for LPIPS; `None`: LPIPS is not scored.
    pub lpips: Option<Lpips>,
}
