//! Maps together with the recordings of their frames.
//!
//! gRPC and HTTP create, open and delete maps here, so that a map and its recording stay in step, and
//! the server rebuilds all maps from their recordings here when it starts.

mod error;
mod recorded;
mod replay;

pub(crate) use error::MapsError;
pub(crate) use recorded::{RecordedMaps, Recording};
pub(crate) use replay::replay;

#[cfg(test)]
mod tests;
