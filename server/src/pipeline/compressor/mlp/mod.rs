//! The paper's online auto-encoder: 32-24-15-24-32 (§4.2, the OLAE).
//!
//! The initial keyframes train it for some hundred steps. Each later keyframe adds one step for
//! itself and one for each of a few earlier keyframes, drawn at random, against forgetting. Samples
//! of at most [`KEPT_KEYFRAMES`] keyframes are kept for that.
//!
//! Each step moves the code space a little. Existing codes are converted by the affine map that
//! best takes the old codes of the kept samples to their new codes. To decode and encode again
//! instead would add the network's reconstruction error at each step.

mod affine_map;
mod net;

use super::config::CompressorConfig;
use super::online_stage::OnlineStage;
use crate::pipeline::network::GENERIC_SIZE;
use crate::pipeline::saving::packed;
use affine_map::AffineMap;
use net::{Adam, Net};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Codes kept of a keyframe, spread evenly over it.
const SAMPLED_CODES: usize = 1024;
/// Keyframes with a kept sample. Later keyframes replace random earlier ones (reservoir sampling).
const KEPT_KEYFRAMES: usize = 256;
/// Kept codes to which the affine map is fitted.
const FITTED_CODES: usize = 4096;
/// Rows encoded or decoded by one core at a time.
const BATCH: usize = 2048;

/// Codes of a keyframe, `[n, 32]`.
#[derive(Clone, Serialize, Deserialize)]
struct Sample(#[serde(with = "packed")] Arc<[f64]>);

/// The online auto-encoder and its optimiser.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Mlp {
    net: Net,
    adam: Adam,
    random: ChaCha8Rng,
    version: u64,
    keyframes: usize,
    /// Samples `[n, 32]` of keyframes.
    kept: Vec<Sample>,
    initial_steps: usize,
    initial_keyframes: usize,
    replayed: usize,
}

impl Mlp {
    /// The state before any keyframe, with random weights.
    pub(super) fn new(config: &CompressorConfig) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(config.seed);
        let net = Net::new(config.code_size, &mut random);
        let adam = Adam::new(config.learning_rate, net.parameters.len());
        Self {
            net,
            adam,
            random,
            version: 0,
            keyframes: 0,
            kept: Vec::new(),
            initial_steps: config.initial_steps,
            initial_keyframes: config.initial_keyframes,
            replayed: config.replayed,
        }
    }

    fn step(&mut self, sample: &[f64]) {
        let (_, gradient) = self.net.loss_and_gradient(sample);
        self.adam.step(&mut self.net.parameters, &gradient);
    }

    /// One step on a random kept keyframe.
    fn replay(&mut self) {
        let sample = self.kept[self.random.random_range(0..self.kept.len())].clone();
        self.step(&sample.0);
    }

    /// At most [`FITTED_CODES`] of the kept rows `[n, 32]`, evenly spread.
    fn samples(&self) -> Vec<f32> {
        let rows: usize = self.kept.iter().map(|sample| sample.0.len() / GENERIC_SIZE).sum();
        let stride = rows.div_ceil(FITTED_CODES).max(1);
        let kept = self.kept.iter().flat_map(|sample| sample.0.chunks_exact(GENERIC_SIZE));
        kept.step_by(stride).flatten().map(|&value| value as f32).collect()
    }

    /// Keeps a sample; each keyframe so far stays with equal probability.
    fn keep(&mut self, sample: Sample) {
        if self.kept.len() < KEPT_KEYFRAMES {
            self.kept.push(sample);
            return;
        }
        let at = self.random.random_range(0..self.keyframes);
        if at < KEPT_KEYFRAMES {
            self.kept[at] = sample;
        }
    }
}

impl OnlineStage for Mlp {
    fn code_size(&self) -> usize {
        self.net.code_size()
    }

    fn version(&self) -> u64 {
        self.version
    }

    fn observe(&mut self, generic: &[f32]) -> bool {
        let sample = sampled(generic);
        if sample.0.is_empty() {
            return false;
        }
        self.keyframes += 1;
        self.step(&sample.0);
        if self.keyframes <= self.initial_keyframes {
            self.keep(sample);
            let steps = self.initial_steps / self.initial_keyframes;
            (1..steps).for_each(|_| self.replay());
        } else {
            (0..self.replayed).for_each(|_| self.replay());
            self.keep(sample);
        }
        self.version += 1;
        true
    }

    fn encode(&self, generic: &[f32]) -> Vec<f32> {
        in_batches(generic, GENERIC_SIZE, |batch| self.net.encode(batch))
    }

    fn decode(&self, codes: &[f32]) -> Vec<f32> {
        in_batches(codes, self.code_size(), |batch| self.net.decode(batch))
    }

    fn carried(&self, old: &dyn OnlineStage, codes: &[f32]) -> Vec<f32> {
        let samples = self.samples();
        let (from, to) = (old.encode(&samples), self.encode(&samples));
        match AffineMap::fit(self.code_size(), &from, &to) {
            Some(map) => map.apply(codes),
            None => self.encode(&old.decode(codes)),
        }
    }

    fn save(&self) -> Vec<u8> {
        rmp_serde::to_vec_named(self).expect("numbers can be written")
    }

    fn boxed_clone(&self) -> Box<dyn OnlineStage> {
        Box::new(self.clone())
    }
}

fn in_batches(rows: &[f32], channels: usize, run: impl Fn(&[f64]) -> Vec<f64> + Sync) -> Vec<f32> {
    rows.par_chunks(BATCH * channels)
        .flat_map_iter(|batch| {
            let batch: Vec<f64> = batch.iter().map(|&value| value.into()).collect();
            run(&batch).into_iter().map(|value| value as f32)
        })
        .collect()
}

/// At most [`SAMPLED_CODES`] finite, non-zero rows, evenly spread.
fn sampled(generic: &[f32]) -> Sample {
    let rows: Vec<&[f32]> = generic
        .chunks_exact(GENERIC_SIZE)
        .filter(|row| row.iter().all(|value| value.is_finite()) && row.iter().any(|&v| v != 0.0))
        .collect();
    let count = rows.len().min(SAMPLED_CODES);
    let picked = (0..count).map(|i| rows[i * rows.len() / count]);
    Sample(picked.flatten().map(|&value| value.into()).collect())
}
