//! The stages that build the map (paper §4.3), one file each.
//!
//! In: the live map, a tracked frame, a keyframe's language. Out: the live map changed. The map's thread
//! (`map_thread/`) decides which stage runs when. Stages know no threads and no queues.

mod config;
pub(super) mod insert;
pub(super) mod language;
pub(super) mod optimise;
mod pose_refinement;
mod prune;
pub(super) mod refine;
pub(super) mod select;
mod step_config;
mod turn;

pub use config::{Clock, MapperConfig};
pub use step_config::TiesConfig;
