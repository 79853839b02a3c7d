//! The paper's online auto-encoder: 32-24-15-24-32 (§4.2, the OLAE).
//!
//! The first keyframes train it for some hundred steps; then each keyframe gets one step, and so do
//! a few earlier ones, drawn at random, against forgetting. A bounded sample of every keyframe is
//! kept, of at most [`KEPT_KEYFRAMES`] keyframes.
//!
//! Every step moves the code space a little. Codes follow it by the affine map that takes the kept
//! samples' old codes to their new ones, which is all but the curvature of that move. Decoding and
//! encoding again would lose what the network loses, anew at every step.

mod follow;
mod net;

use super::{CompressorConfig, GENERIC, OnlineStage};
use follow::AffineMap;
use net::{Adam, Net};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::sync::Arc;

/// Codes kept of a keyframe, spread evenly over it.
const SAMPLED_CODES: usize = 1024;
/// Keyframes of which a sample is kept; later ones replace random earlier ones (reservoir
/// sampling).
const KEPT_KEYFRAMES: usize = 256;
/// Kept codes that say how the code space has moved.
const FOLLOWED_CODES: usize = 4096;
/// Rows that one core encodes or decodes at a time.
const BATCH: usize = 2048;

/// The online auto-encoder and its optimiser.
#[derive(Clone)]
pub struct Mlp {
    net: Net,
    adam: Adam,
    random: ChaCha8Rng,
    version: u64,
    keyframes: usize,
    /// `[n, 32]` of some of the keyframes so far.
    kept: Vec<Arc<[f64]>>,
    initial_steps: usize,
    initial_keyframes: usize,
    replayed: usize,
}

impl Mlp {
    /// Before any keyframe, random weights.
    pub fn new(config: &CompressorConfig) -> Self {
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
        self.step(&sample);
    }

    /// At most [`FOLLOWED_CODES`] rows `[n, 32]`, evenly from all that is kept.
    fn samples(&self) -> Vec<f32> {
        let rows: usize = self.kept.iter().map(|sample| sample.len() / GENERIC).sum();
        let stride = rows.div_ceil(FOLLOWED_CODES).max(1);
        let kept = self.kept.iter().flat_map(|sample| sample.chunks_exact(GENERIC));
        kept.step_by(stride).flatten().map(|&value| value as f32).collect()
    }

    /// Every keyframe so far stays with the same probability.
    fn keep(&mut self, sample: Arc<[f64]>) {
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
        if sample.is_empty() {
            return false;
        }
        self.keyframes += 1;
        self.step(&sample);
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
        in_batches(generic, GENERIC, |batch| self.net.encode(batch))
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

/// At most [`SAMPLED_CODES`] rows that have a direction, evenly spread.
fn sampled(generic: &[f32]) -> Arc<[f64]> {
    let rows: Vec<&[f32]> = generic
        .chunks_exact(GENERIC)
        .filter(|row| row.iter().all(|value| value.is_finite()) && row.iter().any(|&v| v != 0.0))
        .collect();
    let count = rows.len().min(SAMPLED_CODES);
    let picked = (0..count).map(|i| rows[i * rows.len() / count]);
    picked.flatten().map(|&value| value.into()).collect()
}
