//! Where the frames of a stream go: into a map of this server, or to the fleet.

use crate::check::{Limits, Opening, Refusal};
use futures::future::BoxFuture;
use lexsplat_proto::v1::{self, FrameAck};
use std::time::Instant;
use tonic::Status;

/// Resolves to the acknowledgement of a frame.
pub(crate) type Acked = BoxFuture<'static, Result<FrameAck, Status>>;

/// Opens maps for senders.
pub(crate) trait Destinations: Clone + Send + Sync + 'static {
    /// An open map.
    type One: Destination;

    /// Opens the map that a checked opening message names. Dropping it frees the map for another sender.
    fn destination(
        &self,
        open: &v1::OpenMap,
    ) -> impl Future<Output = Result<Self::One, Status>> + Send;
}

/// A map that takes the frames of one stream.
pub(crate) trait Destination: Send + Sync + 'static {
    /// What the checks make of a frame.
    type Checked: Send + 'static;

    /// Sequence of the newest frame that the map has.
    fn received_through(&self) -> Option<u64>;

    /// Checks a frame, on a blocking thread.
    fn check(
        wire: &v1::Frame,
        opening: &Opening,
        newest: Option<u64>,
        limits: &Limits,
    ) -> Result<Self::Checked, Refusal>;

    /// Keeps a frame that passed the checks. Returns what its acknowledgement will be, and when the wait for
    /// it began.
    fn keep(
        &mut self,
        wire: v1::Frame,
        checked: Self::Checked,
    ) -> impl Future<Output = Result<(Acked, Instant), Status>> + Send;

    fn count_refused(&self);

    /// Adds to an acknowledgement what the map says when it is sent.
    fn completer(&self) -> Box<dyn Fn(&mut FrameAck) + Send + Sync>;

    /// The stream has ended.
    fn end(&mut self) -> impl Future<Output = ()> + Send;
}
