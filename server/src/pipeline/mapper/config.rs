//! The mapper's settings, section `[mapper]`.

use serde::{Deserialize, Serialize};

/// How the map is built. Constants of the paper's code are in brackets where ours differ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MapperConfig {
    /// Maps on one server.
    pub max_maps: usize,
    /// Frames that may wait for the mapper; then their sender waits.
    pub queue_frames: usize,
    /// When the optimiser works.
    pub clock: Clock,
    /// Color and depth are optimised at this many columns at most (full size in the paper).
    pub train_width: u32,
    /// New keyframe: moved by more than this share of the median depth.
    pub keyframe_translation: f64,
    /// New keyframe: turned by more than this, radians.
    pub keyframe_rotation_radians: f64,
    /// New keyframe: this share of what it shows is on no keyframe of the window.
    pub keyframe_novelty: f64,
    /// New Gaussians: one per square of the optimised image, of this side where it is flat, pixels.
    pub insert_max_pixels: u32,
    /// The side of the smallest square, where there is detail, pixels.
    pub insert_min_pixels: u32,
    /// A square is halved where a channel differs by more than this (0..1).
    pub insert_detail: f32,
    /// Insert where less than this is opaque.
    pub insert_opacity: f32,
    /// Insert where the map lies behind the measured depth by this share of it.
    pub insert_depth_error: f32,
    /// Insert where the mean absolute color error is above this (0..1).
    pub insert_color_error: f32,
    /// Where so many keyframes have shown a place from as near, only what is open is filled any more.
    pub insert_keyframes: usize,
    /// What has color and no depth is put so many times as far as the farthest thing measured; 0: nowhere.
    pub insert_backdrop: f32,
    /// Gaussians at most; then nothing is inserted any more, and what is there goes on being improved.
    pub max_gaussians: usize,
    /// Mebibytes that keyframes' pictures and codes take at most, the device's too; then the keyframe that
    /// others show best is let go. Its Gaussians stay.
    pub max_keyframe_mib: u64,
    /// Optimiser steps that each keyframe earns; taken when no frame waits.
    pub steps_per_keyframe: usize,
    /// Steps that are taken behind each frame even when others wait.
    pub steps_per_frame: usize,
    /// What a frame shows is new if none of this many newest keyframes shows it.
    pub window: usize,
    /// Every how many steps language is optimised as well. A keyframe's language earns as many steps as this leaves
    /// it of `steps_per_keyframe`, whenever it comes.
    pub language_every: usize,
    /// Every how many steps transparent Gaussians are removed.
    pub prune_every: usize,
    /// A Gaussian goes when both heads' opacities are below this (0.7).
    pub prune_opacity: f32,
    /// Readers get a new snapshot at most this often while the map changes, seconds.
    pub snapshot_seconds: f64,
    /// Which parameters of the two heads are one (none in the paper's full method; all: the joint
    /// optimisation that it is compared with).
    pub ties: TiesConfig,
    /// Weights of the loss (paper §4.3).
    pub loss: LossConfig,
    /// Adam's learning rates.
    pub rates: RatesConfig,
}

/// When the optimiser works.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// Frames come first, steps while there are none.
    Realtime,
    /// A frame waits until the one before has its language and all its steps: the same input gives the
    /// same map, bit for bit on one adapter, however fast it comes.
    PerFrame,
}

/// Parameters that color and language share, so that both losses move them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TiesConfig {
    /// Quaternions.
    pub rotation: bool,
    /// Scales.
    pub scale: bool,
    /// Opacities.
    pub opacity: bool,
}

/// Weights of the loss terms, each a mean.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LossConfig {
    /// L1 of color.
    pub color: f32,
    /// L1 of depth, per metre.
    pub depth: f32,
    /// L1 of language codes.
    pub language: f32,
    /// Distance of the color head's scales from their mean.
    pub isotropic: f32,
    /// |S_f - sg(S_c)|: the language head's scales stay near the color head's.
    pub scale_tie: f32,
}

/// Learning rates of the parameter groups.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RatesConfig {
    /// Means, metres.
    pub mean: f32,
    /// Quaternions of the color head.
    pub rotation: f32,
    /// Log-scales of the color head.
    pub scale: f32,
    /// Opacity logits of the color head.
    pub opacity: f32,
    /// Colors.
    pub color: f32,
    /// Quaternions of the language head.
    pub language_rotation: f32,
    /// Log-scales of the language head.
    pub language_scale: f32,
    /// Opacity logits of the language head.
    pub language_opacity: f32,
    /// Codes.
    pub code: f32,
}

impl Default for MapperConfig {
    fn default() -> Self {
        Self {
            max_maps: 8,
            queue_frames: 8,
            clock: Clock::Realtime,
            train_width: 600,
            keyframe_translation: 0.08,
            keyframe_rotation_radians: 0.15,
            keyframe_novelty: 0.1,
            insert_max_pixels: 8,
            insert_min_pixels: 2,
            insert_detail: 0.1,
            insert_opacity: 0.6,
            insert_depth_error: 0.05,
            insert_color_error: 0.1,
            insert_keyframes: 8,
            insert_backdrop: 1.25,
            max_gaussians: 400_000,
            max_keyframe_mib: 2048,
            steps_per_keyframe: 28,
            steps_per_frame: 1,
            window: 8,
            language_every: 4,
            prune_every: 200,
            prune_opacity: 0.05,
            snapshot_seconds: 2.0,
            ties: TiesConfig::default(),
            loss: LossConfig::default(),
            rates: RatesConfig::default(),
        }
    }
}

impl Default for LossConfig {
    fn default() -> Self {
        Self { color: 0.95, depth: 0.05, language: 1.0, isotropic: 0.5, scale_tie: 10.0 }
    }
}

impl Default for RatesConfig {
    fn default() -> Self {
        Self {
            mean: 7e-4,
            rotation: 1e-2,
            scale: 5e-3,
            opacity: 0.05,
            color: 5e-3,
            language_rotation: 1e-3,
            language_scale: 1.2e-3,
            language_opacity: 0.05,
            code: 5e-3,
        }
    }
}
