//! Relevancy of features to texts (paper §5; from LERF), maps of it, and the confidence.

mod confidence;
mod cosines;
mod map;
mod prompts;

pub(super) use confidence::{Calibration, Evidenced, is_present};
pub(super) use cosines::to_bf16;
pub(super) use map::RelevancyMap;
pub(super) use prompts::{Prompts, Scale};
