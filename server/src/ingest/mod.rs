//! The gRPC interface: streams of frames in, acknowledgements and answers out.
//!
//! Messages are validated by `check`; this module translates between the wire and the pipeline. It
//! reads maps through snapshots and statuses only.

mod chunks;
mod config;
mod context;
mod destination;
mod guard;
mod local;
mod maps;
mod query;
mod router;
mod service;
mod status;
mod stream;
mod unfinished;

pub use config::IngestConfig;
pub(crate) use destination::{Acked, Destination, Destinations};
pub(crate) use guard::{caller, permit};
pub(crate) use local::outcome_ack;
pub(crate) use maps::wire_listed;
pub use router::IngestError;
pub(crate) use router::router;
pub(crate) use service::MappingService;
pub(crate) use status::{of_map, refused};
pub(crate) use stream::{Terms, refused_ack, start};

#[cfg(test)]
mod tests;
