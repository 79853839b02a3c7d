//! Settings of an optimiser step: what the heads share, weights of the loss, learning rates, and the tiles
//! that it looks at.

use super::super::range::{OutOfRange, at_least, within};
use serde::{Deserialize, Serialize};

/// Largest learning rate. One step of Adam moves a parameter by about its rate.
const MAX_RATE: f32 = 1.0;

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

/// Weights of the loss terms. Each term is a mean.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LossConfig {
    /// L1 of color, channels 0 to 1.
    pub color: f32,
    /// L1 of depth, per metre.
    pub depth: f32,
    /// L1 of language codes.
    pub language: f32,
    /// Distance of the color head's scales from their mean.
    pub isotropic: f32,
    /// |S_f - sg(S_c)|: distance of the language head's scales from the color head's.
    pub scale_tie: f32,
}

/// How likely a color step looks at a tile of its keyframe (8x8 or 16x16 pixels).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FocusConfig {
    /// Probability of a tile with the mean error of the keyframe's tiles. It grows with the error, up to 1.
    pub mean_share: f32,
    /// Probability of a tile without error; 1: steps look at all tiles.
    pub least_share: f32,
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
    /// Colors, 0 to 1.
    pub color: f32,
    /// Quaternions of the language head.
    pub language_rotation: f32,
    /// Log-scales of the language head.
    pub language_scale: f32,
    /// Opacity logits of the language head.
    pub language_opacity: f32,
    /// Language codes.
    pub code: f32,
    /// Factor of a Gaussian's first color step, on all rates but language's,
    pub first: f32,
    /// whose distance from 1 falls to 1/e in this many of its steps.
    pub first_steps: f32,
}

impl LossConfig {
    pub(super) fn check(&self) -> Result<(), OutOfRange> {
        at_least("mapper.loss.color", self.color, 0.0)?;
        at_least("mapper.loss.depth", self.depth, 0.0)?;
        at_least("mapper.loss.language", self.language, 0.0)?;
        at_least("mapper.loss.isotropic", self.isotropic, 0.0)?;
        at_least("mapper.loss.scale_tie", self.scale_tie, 0.0)
    }
}

impl FocusConfig {
    pub(super) fn check(&self) -> Result<(), OutOfRange> {
        at_least("mapper.focus.mean_share", self.mean_share, 0.0)?;
        within("mapper.focus.least_share", self.least_share, 0.0..=1.0)
    }
}

impl RatesConfig {
    pub(super) fn check(&self) -> Result<(), OutOfRange> {
        let rate = |key, value| within(key, value, 0.0..=MAX_RATE);
        rate("mapper.rates.mean", self.mean)?;
        rate("mapper.rates.rotation", self.rotation)?;
        rate("mapper.rates.scale", self.scale)?;
        rate("mapper.rates.opacity", self.opacity)?;
        rate("mapper.rates.color", self.color)?;
        rate("mapper.rates.language_rotation", self.language_rotation)?;
        rate("mapper.rates.language_scale", self.language_scale)?;
        rate("mapper.rates.language_opacity", self.language_opacity)?;
        rate("mapper.rates.code", self.code)?;
        within("mapper.rates.first", self.first, 0.0..=100.0)?;
        within("mapper.rates.first_steps", self.first_steps, 0.1..=1e6)
    }
}

impl Default for LossConfig {
    fn default() -> Self {
        Self { color: 0.95, depth: 0.05, language: 1.0, isotropic: 0.5, scale_tie: 10.0 }
    }
}

impl Default for FocusConfig {
    fn default() -> Self {
        Self { mean_share: 1.0, least_share: 0.2 }
    }
}

impl Default for RatesConfig {
    fn default() -> Self {
        Self {
            mean: 1e-3,
            rotation: 2e-2,
            scale: 5e-3,
            opacity: 0.08,
            color: 5e-3,
            language_rotation: 1e-3,
            language_scale: 1.2e-3,
            language_opacity: 0.05,
            code: 5e-3,
            first: 2.0,
            first_steps: 16.0,
        }
    }
}
