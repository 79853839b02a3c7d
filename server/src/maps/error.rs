//! Errors of recorded maps.

use crate::pipeline::map::MapError;
use crate::store::StoreError;

#[derive(Debug, thiserror::Error)]
pub(crate) enum MapsError {
    #[error(transparent)]
    Map(#[from] MapError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("creating the map panicked: the server's log has the message")]
    Panicked,
}
