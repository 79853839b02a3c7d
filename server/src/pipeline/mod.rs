//! The paper's pipeline, one folder for each stage: tracker, encoder, SRD, compressor, mapper, query.
//!
//! In: checked [`frame::Frame`]s and [`query::Query`]s. Out: outcomes, snapshots, answers. One thread for
//! each map owns its live state. All maps share one thread that owns the vision networks and one that
//! answers questions from snapshots. Nothing here knows gRPC or HTTP.

mod backdrop;
mod bilinear;
pub mod checkpoint;
pub mod closure;
pub mod compressor;
mod downsampled_frame;
pub mod encoder;
pub mod engine;
pub mod evidence;
mod exposure;
pub mod frame;
mod frame_times;
mod input_check;
pub mod input_warning;
mod keyframes;
mod live_map;
pub mod map;
mod map_thread;
pub mod mapper;
pub mod network;
mod pose_adam;
mod pose_covariance;
mod pose_graph;
mod quantile;
pub mod query;
pub mod range;
pub mod registration;
mod saving;
pub mod snapshot;
mod srd;
pub mod tracker;
pub mod up;
