//! The HTTP interface: questions, rendered images, files and events of the maps, as JSON, PNG, PLY
//! and server-sent events. Errors are RFC 9457 problem documents.
//!
//! Requests are validated by `check`; this module translates between HTTP and the pipeline. It
//! reads maps through snapshots and statuses only.

mod answer_cache;
mod answers;
mod backup;
mod browser;
mod config;
mod error;
mod event_log;
mod events;
mod export;
mod extract;
mod file_cache;
mod guard;
mod health;
mod import;
mod map;
mod openapi;
mod pace;
mod query;
mod range;
mod reading;
mod received;
mod render;
mod router;
mod schema;
mod session;
mod state;
mod to_json;

pub use config::HttpConfig;
pub(crate) use router::{Context, router};

#[cfg(test)]
mod tests;
