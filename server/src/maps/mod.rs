//! Maps together with the recordings of their frames and their checkpoints.
//!
//! gRPC and HTTP create, open and delete maps here, so that a map and its recording stay in step. When the
//! server starts, maps are loaded here, in the order in which they are asked for: the newest checkpoint, then
//! the frames that were recorded after it. Checkpoints are written while the server runs and when it stops.

mod backup;
mod error;
mod feed;
mod load;
mod places;
mod progress;
mod recorded;
mod recording;
mod rename;
mod replay;
mod room;
mod save;

pub(crate) use backup::{BackupError, backup, restore};
pub(crate) use error::MapsError;
pub(crate) use feed::{Fed, Feed};
#[cfg(test)]
pub(crate) use load::load_all;
pub(crate) use load::{Unusable, keep_loading, read_checkpoint};
pub(crate) use progress::LoadProgress;
pub(crate) use recorded::{Elsewhere, Listed, RecordedMaps};
pub(crate) use recording::Recording;
pub(crate) use rename::{RenameError, rename};
pub(crate) use room::watch_room;
pub(crate) use save::{save_all, save_every};

#[cfg(test)]
mod tests;
