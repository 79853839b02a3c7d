//! Errors of recorded maps.

use super::progress::LoadProgress;
use crate::pipeline::map::MapError;
use crate::store::StoreError;

#[derive(Debug, thiserror::Error)]
pub(crate) enum MapsError {
    #[error(transparent)]
    Map(#[from] MapError),
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The map was there before the server was started, and is not there again yet.
    #[error("map {name:?} is being loaded: {progress}. Try again in a few seconds")]
    Loading { name: String, progress: LoadProgress },
    /// This server is a worker of a fleet.
    #[error(
        "this server is a worker of a fleet, which maps what the fleet's log has: ask a gateway of the fleet"
    )]
    OfFleet,
    #[error("creating the map panicked: the server's log has the message")]
    Panicked,
}
