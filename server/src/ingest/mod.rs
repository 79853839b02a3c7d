//! The gRPC interface: streams of frames in, acknowledgements and answers out.
//!
//! Messages are validated by `check`; this module translates between the wire and the pipeline. It
//! reads maps through snapshots and statuses only.

mod chunks;
mod config;
mod context;
mod guard;
mod maps;
mod query;
mod service;
mod status;
mod stream;
mod unfinished;

pub use config::IngestConfig;
pub use service::IngestError;
pub(crate) use service::MappingService;

#[cfg(test)]
mod tests;
