//! Options of streaming a data set.

use crate::access::Access;
use std::num::NonZeroUsize;

/// Where the poses of the map come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Poses {
    /// From the data set.
    #[default]
    Given,
    /// The server tracks the camera itself; the data set only gives the pose of the first frame.
    Estimate,
}

/// Where the map's language comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoder {
    /// The server's networks encode each keyframe.
    #[default]
    Bundle,
    /// The data set's masks: each pixel's language is the name of its class.
    Oracle,
}

/// Server, map and kind of a stream.
#[derive(Clone, Debug)]
pub struct StreamOptions {
    /// The server's gRPC address: `HOST:PORT`, `http://HOST:PORT` or `https://HOST:PORT`.
    pub grpc: String,
    /// Token and certificates.
    pub access: Access,
    /// Name of the map to create or resume.
    pub map: String,
    /// Where poses come from.
    pub poses: Poses,
    /// Where language comes from.
    pub encoder: Encoder,
    /// Every N-th frame is held out: tracked, and never a keyframe. `None`: none is.
    pub hold_out_every: Option<NonZeroUsize>,
    /// Whether frames are sent at the pace of their timestamps instead of as fast as possible.
    pub realtime: bool,
}
