//! Settings of the mapper, section `[mapper]`.

use super::super::range::{
    DAY, MAX_COLUMNS, MAX_COUNT, MAX_KEPT, OutOfRange, at_least, require, within,
};
use super::step_config::{FocusConfig, LossConfig, RatesConfig, TiesConfig};
use serde::{Deserialize, Serialize};

/// Most Gaussians that an index of the GPU tells apart.
const MAX_GAUSSIANS: usize = u32::MAX as usize;
/// Most mebibytes of a budget: one tebibyte.
const MAX_MIB: u64 = 1 << 20;

/// How the map is built. Values of the paper's code are in brackets where the defaults differ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MapperConfig {
    /// Most maps on one server.
    pub max_maps: usize,
    /// Frames that may wait for a map. When the queue is full their sender waits.
    pub queue_frames: usize,
    /// When optimiser steps are taken.
    pub clock: Clock,
    /// Color and depth are optimised at this many columns at most [full size].
    pub train_width: u32,
    /// A frame becomes a keyframe if it moved by more than this share of the median depth,
    pub keyframe_translation: f64,
    /// or turned by more than this, radians,
    pub keyframe_rotation_radians: f64,
    /// or if more than this share of its surface is shown by no keyframe of the window.
    pub keyframe_novelty: f64,
    /// Side of the largest cell that gets one new Gaussian, pixels of the training image.
    pub insert_max_pixels: u32,
    /// Side of the smallest such cell, pixels.
    pub insert_min_pixels: u32,
    /// A cell is divided if the range of a color channel in it is larger, 0 to 1.
    pub insert_detail: f32,
    /// Gaussians are inserted where the map's opacity is below this,
    pub insert_opacity: f32,
    /// or where the map lies behind the measured depth by more than this share of it,
    pub insert_depth_error: f32,
    /// or where the mean absolute color error is above this, 0 to 1.
    pub insert_color_error: f32,
    /// A keyframe whose colors differ by more than this from an earlier keyframe's (0 to 1, median over
    /// the surfaces that both show) adds larger Gaussians, from half as many visits. Rendered frames differ
    /// by up to 0.0075, those of real cameras by 0.007 to 0.05. 1: never.
    pub insert_disagreement: f32,
    /// Where this many keyframes have shown a place from as near, Gaussians are inserted only if the map is
    /// transparent there.
    pub insert_keyframes: usize,
    /// Distance of the backdrop (color without depth) in units of the largest depth that was measured; 0: no
    /// backdrop.
    pub insert_backdrop: f32,
    /// Most Gaussians of a map. When it is reached none is inserted, and the existing ones are still
    /// optimised.
    pub max_gaussians: usize,
    /// Mebibytes of keyframes' images and codes in host memory. Above it the keyframe that
    /// the others show best is forgotten. Its Gaussians stay.
    pub max_keyframe_mib: u64,
    /// Color steps of each keyframe, taken while no frame waits.
    pub steps_per_keyframe: usize,
    /// Steps taken after each frame even if others wait (clock `realtime`).
    pub steps_per_frame: usize,
    /// While no frame waits and no step is due, the map is refined at the size at which keyframes were
    /// received, in at most this many sweeps through all of them; 0: never.
    pub refine_sweeps: usize,
    /// Number of newest keyframes that decide whether a frame shows something new. At least half of
    /// the steps are theirs.
    pub window: usize,
    /// One in this many color steps on a keyframe also optimises its language, which gets the same share of
    /// `steps_per_keyframe`, whenever it arrives.
    pub language_every: usize,
    /// Transparent Gaussians are removed every this many steps.
    pub prune_every: usize,
    /// A Gaussian is removed if the opacities of both heads are below this [0.7].
    pub prune_opacity: f32,
    /// Least time between two snapshots while the map changes and is read, seconds (clock `realtime`).
    pub snapshot_seconds: f64,
    /// Parameters that the two heads share (none in the paper's method; all of them is the joint
    /// optimisation that it is compared with).
    pub ties: TiesConfig,
    /// Weights of the loss (paper §4.3).
    pub loss: LossConfig,
    /// Adam's learning rates.
    pub rates: RatesConfig,
    /// Which tiles of a keyframe a step looks at.
    pub focus: FocusConfig,
}

/// When optimiser steps are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// Frames come first, steps are taken while none waits.
    Realtime,
    /// A frame waits until the keyframe before it has its language and all its steps. The same input then
    /// gives the same map, bit for bit on one adapter.
    PerFrame,
}

impl MapperConfig {
    /// Checks the range of each number.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        within("mapper.max_maps", self.max_maps, 1..=MAX_KEPT)?;
        within("mapper.queue_frames", self.queue_frames, 1..=MAX_KEPT)?;
        within("mapper.train_width", self.train_width, 1..=MAX_COLUMNS)?;
        at_least("mapper.keyframe_translation", self.keyframe_translation, 0.0)?;
        at_least("mapper.keyframe_rotation_radians", self.keyframe_rotation_radians, 0.0)?;
        within("mapper.keyframe_novelty", self.keyframe_novelty, 0.0..=1.0)?;
        self.check_insertion()?;
        within("mapper.max_keyframe_mib", self.max_keyframe_mib, 1..=MAX_MIB)?;
        within("mapper.window", self.window, 1..=MAX_COUNT)?;
        within("mapper.language_every", self.language_every, 1..=MAX_COUNT)?;
        within("mapper.prune_every", self.prune_every, 1..=MAX_COUNT)?;
        within("mapper.prune_opacity", self.prune_opacity, 0.0..=1.0)?;
        within("mapper.snapshot_seconds", self.snapshot_seconds, 0.0..=DAY as f64)?;
        within("mapper.steps_per_keyframe", self.steps_per_keyframe, 0..=MAX_COUNT)?;
        within("mapper.steps_per_frame", self.steps_per_frame, 0..=MAX_COUNT)?;
        within("mapper.refine_sweeps", self.refine_sweeps, 0..=MAX_COUNT)?;
        self.loss.check()?;
        self.focus.check()?;
        self.rates.check()
    }

    fn check_insertion(&self) -> Result<(), OutOfRange> {
        let [min, max] = [self.insert_min_pixels, self.insert_max_pixels];
        within("mapper.insert_min_pixels", min, 1..=MAX_COLUMNS)?;
        within("mapper.insert_max_pixels", max, min..=MAX_COLUMNS)?;
        within("mapper.insert_detail", self.insert_detail, 0.0..=1.0)?;
        within("mapper.insert_opacity", self.insert_opacity, 0.0..=1.0)?;
        at_least("mapper.insert_depth_error", self.insert_depth_error, 0.0)?;
        within("mapper.insert_color_error", self.insert_color_error, 0.0..=1.0)?;
        within("mapper.insert_disagreement", self.insert_disagreement, 0.0..=1.0)?;
        within("mapper.insert_keyframes", self.insert_keyframes, 0..=MAX_COUNT)?;
        let backdrop = self.insert_backdrop;
        require(
            backdrop == 0.0 || (backdrop > 1.0 && backdrop.is_finite()),
            "mapper.insert_backdrop",
            backdrop,
            "0, or a finite number, more than 1",
        )?;
        within("mapper.max_gaussians", self.max_gaussians, 1..=MAX_GAUSSIANS)
    }
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
            insert_disagreement: 0.009,
            insert_keyframes: 8,
            insert_backdrop: 1.25,
            max_gaussians: 400_000,
            max_keyframe_mib: 2048,
            steps_per_keyframe: 14,
            steps_per_frame: 1,
            refine_sweeps: 20,
            window: 8,
            language_every: 2,
            prune_every: 200,
            prune_opacity: 0.05,
            snapshot_seconds: 2.0,
            ties: TiesConfig::default(),
            loss: LossConfig::default(),
            rates: RatesConfig::default(),
            focus: FocusConfig::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::range::table::{Case, assert_checks};
    use super::*;

    const CASES: &[Case<MapperConfig>] = &[
        (
            "mapper.insert_keyframes",
            |c| c.insert_keyframes = MAX_COUNT + 1,
            |c| c.insert_keyframes = 0,
        ),
        (
            "mapper.steps_per_keyframe",
            |c| c.steps_per_keyframe = MAX_COUNT + 1,
            |c| c.steps_per_keyframe = 0,
        ),
        (
            "mapper.steps_per_frame",
            |c| c.steps_per_frame = MAX_COUNT + 1,
            |c| c.steps_per_frame = 0,
        ),
        ("mapper.refine_sweeps", |c| c.refine_sweeps = MAX_COUNT + 1, |c| c.refine_sweeps = 0),
        ("mapper.max_maps", |c| c.max_maps = 0, |c| c.max_maps = 1),
        ("mapper.queue_frames", |c| c.queue_frames = 0, |c| c.queue_frames = 1),
        ("mapper.train_width", |c| c.train_width = 0, |c| c.train_width = 1),
        (
            "mapper.keyframe_translation",
            |c| c.keyframe_translation = -0.1,
            |c| c.keyframe_translation = 0.0,
        ),
        (
            "mapper.keyframe_rotation_radians",
            |c| c.keyframe_rotation_radians = f64::NAN,
            |c| c.keyframe_rotation_radians = 0.0,
        ),
        ("mapper.keyframe_novelty", |c| c.keyframe_novelty = 1.1, |c| c.keyframe_novelty = 1.0),
        ("mapper.insert_min_pixels", |c| c.insert_min_pixels = 0, |c| c.insert_min_pixels = 1),
        ("mapper.insert_max_pixels", |c| c.insert_max_pixels = 0, |c| c.insert_max_pixels = 64),
        ("mapper.insert_detail", |c| c.insert_detail = -0.1, |c| c.insert_detail = 0.0),
        ("mapper.insert_opacity", |c| c.insert_opacity = 1.1, |c| c.insert_opacity = 1.0),
        (
            "mapper.insert_depth_error",
            |c| c.insert_depth_error = f32::INFINITY,
            |c| c.insert_depth_error = 0.0,
        ),
        (
            "mapper.insert_color_error",
            |c| c.insert_color_error = 1.1,
            |c| c.insert_color_error = 1.0,
        ),
        (
            "mapper.insert_disagreement",
            |c| c.insert_disagreement = -0.1,
            |c| c.insert_disagreement = 1.0,
        ),
        ("mapper.insert_backdrop", |c| c.insert_backdrop = 1.0, |c| c.insert_backdrop = 0.0),
        ("mapper.insert_backdrop", |c| c.insert_backdrop = -2.0, |c| c.insert_backdrop = 1.1),
        ("mapper.max_gaussians", |c| c.max_gaussians = 0, |c| c.max_gaussians = 1),
        ("mapper.max_keyframe_mib", |c| c.max_keyframe_mib = 0, |c| c.max_keyframe_mib = 1),
        ("mapper.window", |c| c.window = 0, |c| c.window = 1),
        ("mapper.language_every", |c| c.language_every = 0, |c| c.language_every = 1),
        ("mapper.prune_every", |c| c.prune_every = 0, |c| c.prune_every = 1),
        ("mapper.prune_opacity", |c| c.prune_opacity = f32::NAN, |c| c.prune_opacity = 0.7),
        ("mapper.snapshot_seconds", |c| c.snapshot_seconds = -1.0, |c| c.snapshot_seconds = 0.0),
        ("mapper.loss.color", |c| c.loss.color = -1.0, |c| c.loss.color = 0.0),
        ("mapper.loss.depth", |c| c.loss.depth = f32::NAN, |c| c.loss.depth = 0.0),
        ("mapper.loss.language", |c| c.loss.language = -1.0, |c| c.loss.language = 0.0),
        ("mapper.loss.isotropic", |c| c.loss.isotropic = -1.0, |c| c.loss.isotropic = 0.0),
        ("mapper.loss.scale_tie", |c| c.loss.scale_tie = -1.0, |c| c.loss.scale_tie = 0.0),
        ("mapper.focus.mean_share", |c| c.focus.mean_share = -0.1, |c| c.focus.mean_share = 0.0),
        ("mapper.focus.least_share", |c| c.focus.least_share = 1.1, |c| c.focus.least_share = 1.0),
        ("mapper.rates.mean", |c| c.rates.mean = -1e-3, |c| c.rates.mean = 0.0),
        ("mapper.rates.rotation", |c| c.rates.rotation = 2.0, |c| c.rates.rotation = 1.0),
        ("mapper.rates.scale", |c| c.rates.scale = f32::NAN, |c| c.rates.scale = 0.0),
        ("mapper.rates.opacity", |c| c.rates.opacity = 2.0, |c| c.rates.opacity = 0.0),
        ("mapper.rates.color", |c| c.rates.color = -1.0, |c| c.rates.color = 0.0),
        (
            "mapper.rates.language_rotation",
            |c| c.rates.language_rotation = -1.0,
            |c| c.rates.language_rotation = 0.0,
        ),
        (
            "mapper.rates.language_scale",
            |c| c.rates.language_scale = 2.0,
            |c| c.rates.language_scale = 0.0,
        ),
        (
            "mapper.rates.language_opacity",
            |c| c.rates.language_opacity = f32::INFINITY,
            |c| c.rates.language_opacity = 0.0,
        ),
        ("mapper.rates.code", |c| c.rates.code = -1.0, |c| c.rates.code = 0.0),
        ("mapper.rates.first", |c| c.rates.first = -1.0, |c| c.rates.first = 1.0),
        ("mapper.rates.first_steps", |c| c.rates.first_steps = 0.0, |c| c.rates.first_steps = 1.0),
    ];

    #[test]
    fn each_number_is_checked() {
        assert_checks("mapper", MapperConfig::check, CASES, &[]);
    }
}
