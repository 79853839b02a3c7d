//! The live map: everything that makes a map what it is, and nothing else.
//!
//! No threads, channels or kernels: the stages of `mapper/` work on this state, and the map's thread decides
//! when. What a checkpoint has to save is this struct.

mod refinement;
mod state;
mod step_budget;
mod trajectory;

pub(super) use refinement::{Refinement, Window};
pub(super) use state::LiveState;
pub(super) use step_budget::StepBudget;
pub(super) use trajectory::Trajectory;

use super::compressor::OnlineStage;
use super::keyframes::{Keyframe, KeyframeStore};
use super::pose_graph::PoseGraph;
use super::up::{self, MapUp, View};
use lexsplat_gpu::{Gaussians, Gpu};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Seed of the random numbers, so that every run is the same.
const SEED: u64 = 0x5eed;

/// The state of one map.
pub(super) struct LiveMap {
    /// Parameters and optimiser state of all Gaussians, on the device.
    pub gaussians: Gaussians,
    pub keyframes: KeyframeStore,
    pub trajectory: Trajectory,
    /// How the poses of keyframes were measured. A Gaussian's owner is a node of it.
    pub graph: PoseGraph,
    /// The online compressor (32 to 15 dimensions) with its dictionary (paper §4.2).
    pub online: Box<dyn OnlineStage>,
    /// Optimiser steps that are due.
    pub steps: StepBudget,
    /// How far the map is refined at full size.
    pub refinement: Refinement,
    /// Chooses the order in which the map is refined.
    pub rng: ChaCha8Rng,
    /// Number of Gaussians when they were last brought into spatial order.
    pub sorted_len: usize,
    /// The largest depth that a keyframe measured, metres.
    pub farthest_metres: f32,
    /// The largest standard deviation with which a Gaussian was inserted, metres.
    pub largest_scale_metres: f32,
    /// Revision of the newest snapshot.
    pub revision: u64,
}

impl LiveMap {
    /// An empty map. `gaussians` have codes of the size that `online` makes.
    pub fn new(gaussians: Gaussians, online: Box<dyn OnlineStage>, steps: StepBudget) -> Self {
        Self {
            gaussians,
            keyframes: KeyframeStore::default(),
            trajectory: Trajectory::default(),
            graph: PoseGraph::default(),
            online,
            steps,
            refinement: Refinement::default(),
            rng: ChaCha8Rng::seed_from_u64(SEED),
            sorted_len: 0,
            farthest_metres: 0.0,
            largest_scale_metres: 0.0,
            revision: 0,
        }
    }

    /// Drops everything but the online stage, which has only learned more, and the revision.
    pub fn clear(&mut self, gpu: &Gpu, steps: StepBudget) {
        self.gaussians = Gaussians::new(gpu, self.online.code_size());
        self.keyframes = KeyframeStore::default();
        self.trajectory = Trajectory::default();
        self.graph = PoseGraph::default();
        self.steps = steps;
        self.refinement = Refinement::default();
        self.sorted_len = 0;
        self.farthest_metres = 0.0;
        self.largest_scale_metres = 0.0;
    }

    /// The direction up; `None` in an empty map.
    pub fn up(&self) -> Option<MapUp> {
        fn view(keyframe: &Keyframe) -> View<'_> {
            View { world_from_camera: &keyframe.frame.world_from_camera, facets: &keyframe.facets }
        }
        let views: Vec<View<'_>> = self.keyframes.iter().map(view).collect();
        let readings = self.trajectory.measured_ups(&self.keyframes);
        up::of_map(self.trajectory.given_up(), &readings, &views)
    }

    /// Whether optimiser steps are due and there is something to optimise.
    pub fn has_steps(&self) -> bool {
        !self.steps.is_empty() && !self.gaussians.is_empty()
    }
}
