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
mod shell;
mod state;
mod to_json;

pub use config::HttpConfig;
pub(crate) use error::Problem;
pub(crate) use extract::{Body, BodyLimits, Options, Segments};
pub(crate) use health::of_process;
pub(crate) use map::PageOfMaps;
pub(crate) use openapi::document;
pub(crate) use router::{Context, router};
pub(crate) use shell::{Shell, shell};
pub(crate) use to_json::listed;

#[cfg(test)]
mod tests;
