//! The parts of a live map that are neither on the device nor keyframes, to be kept and put back.

use super::super::frame::TrackedFrame;
use super::super::pose_graph::PoseGraph;
use super::refinement::Refinement;
use super::step_budget::StepBudget;
use super::trajectory::Trajectory;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// See `LiveMap` for the fields.
#[derive(Serialize, Deserialize)]
pub(in super::super) struct LiveState {
    pub trajectory: Trajectory,
    /// Poses of forgotten keyframes.
    pub forgotten: BTreeMap<u64, TrackedFrame>,
    pub graph: PoseGraph,
    /// The online stage, as it saved itself.
    #[serde(with = "super::super::saving::packed")]
    pub online: Vec<u8>,
    pub steps: StepBudget,
    pub refinement: Refinement,
    pub rng: ChaCha8Rng,
    pub sorted_len: usize,
    pub farthest_metres: f32,
    pub largest_scale_metres: f32,
    pub revision: u64,
}
