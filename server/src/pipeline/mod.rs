//! The paper's pipeline: tracker, encoder, srd, compressor, mapper, query; one folder each.
//!
//! In: checked [`frame::Frame`]s and [`query::Query`]s. Out: acknowledgements, snapshots, answers.
//! Each map has one thread that owns its live state; all maps share one thread that owns the networks
//! for keyframes and one that answers queries from snapshots. Nothing here knows gRPC or HTTP.

mod backdrop;
mod bilinear;
pub mod compressor;
pub mod encoder;
pub mod engine;
pub mod frame;
pub mod map;
pub mod mapper;
pub mod network;
pub mod query;
pub mod range;
pub mod snapshot;
pub mod srd;
pub mod tracker;
mod working;
