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
        "the maps of a fleet come from its frame log: gateways make, fill and delete them. They cannot be renamed, \
         filled by uploads, backed up or restored over this interface"
    )]
    OfFleet,
    #[error("creating the map panicked: the server's log has the message")]
    Panicked,
}
