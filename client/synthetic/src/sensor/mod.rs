//! Simulated **sensors**: a data set with perfect depth and pictures becomes what a real camera would
//! have sent. For clean, rendered data; a recording has its own camera's faults already.
//!
//! In: any [`Dataset`]. Out: the same frames, numbers, poses and truth, with other pictures. The same
//! sensor, seed and frame give the same bytes. [`Dataset::clean_frame`] still gives the clean frame.
//!
//! Not simulated: wrong calibration, bias of depth, multipath, mirrors and glass, other light in
//! infrared than in the picture, noise that stays from frame to frame.

mod blackout;
mod clean;
mod color;
mod depth;
mod motion;
mod noise;
mod preset;
mod surface;

#[cfg(test)]
mod tests;

pub use blackout::Blackout;
pub use preset::{Axial, ColorPreset, D435, KINECT, PERFECT, PHONE, Preset, TOF};

use crate::encode::{rgb_jpeg, units_png};
use clean::{Clean, mean_brightness};
use lexsplat_client::dataset::{
    Color, ColorFormat, Dataset, DatasetError, Depth, DepthFormat, Layer, RgbdFrame,
};
use motion::{Flow, Motion};
use noise::Noise;
use std::collections::BTreeMap;
use std::sync::Mutex;

/// Auto-exposure looks at every N-th frame, and follows with a delay of N to 2 N frames.
const METERED_EVERY: usize = 5;
/// Smallest and largest gain of auto-exposure.
const GAINS: [f32; 2] = [0.5, 2.0];
/// The largest depth that is sent; 65535 would mean "no measurement".
const LARGEST_UNITS: f64 = 65534.0;

/// A data set seen by a simulated sensor.
pub struct Sensed {
    dataset: Box<dyn Dataset>,
    preset: Preset,
    seed: u64,
    /// The frame whose exposure is right: gains are relative to it.
    first: usize,
    /// Mean brightness of the frames that auto-exposure has looked at.
    metered: Mutex<BTreeMap<usize, f32>>,
}

impl Sensed {
    /// The frames of `dataset` as this sensor sends them. `first` is the first frame that will be
    /// used: its gain is 1.
    pub fn new(dataset: Box<dyn Dataset>, preset: Preset, seed: u64, first: usize) -> Self {
        Self { dataset, preset, seed, first, metered: Mutex::default() }
    }

    /// Velocity of the camera, from the frames before and after.
    fn motion(&self, index: usize) -> Result<Motion, DatasetError> {
        let before = self.dataset.moment(index.saturating_sub(1))?;
        let after = self.dataset.moment((index + 1).min(self.dataset.len() - 1))?;
        Ok(Motion::between(&before, &after))
    }

    /// Gain of auto-exposure.
    fn gain(&self, index: usize) -> Result<f32, DatasetError> {
        let strength = self.preset.color.auto_exposure;
        if strength == 0.0 {
            return Ok(1.0);
        }
        let ratio = self.brightness(self.first)? / self.brightness(index)?;
        Ok(ratio.powf(strength).clamp(GAINS[0], GAINS[1]))
    }

    /// Brightness that auto-exposure sees: it changes slowly and lags behind.
    fn brightness(&self, index: usize) -> Result<f32, DatasetError> {
        let newest = index - index % METERED_EVERY;
        let older = newest.saturating_sub(METERED_EVERY);
        let part = (index - newest) as f32 / METERED_EVERY as f32;
        Ok(self.meter(older)? * (1.0 - part) + self.meter(newest)? * part)
    }

    fn meter(&self, index: usize) -> Result<f32, DatasetError> {
        let metered = || self.metered.lock().expect("no thread panics while it holds this");
        if let Some(known) = metered().get(&index) {
            return Ok(*known);
        }
        // A black picture has no gain.
        let camera = self.dataset.intrinsics();
        let brightness = mean_brightness(&self.dataset.frame(index)?, &camera)?.max(1e-3);
        metered().insert(index, brightness);
        Ok(brightness)
    }
}

impl Layer for Sensed {
    fn below(&self) -> &dyn Dataset {
        &*self.dataset
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        let frame = self.dataset.frame(index)?;
        let (camera, unit) = (self.below().intrinsics(), self.depth_unit_metres());
        let clean = Clean::of(&frame, camera, unit)?;
        let flow = Flow::of(&clean, &self.motion(index)?);
        let noise = Noise { seed: self.seed, frame: index as u64 };
        let rgb = color::seen(&clean, &flow, &self.preset.color, self.gain(index)?, noise);
        let depth = depth::measured(&clean, &flow, &self.preset, noise);
        let failed = |source| DatasetError::Encode { sequence: frame.sequence, source };
        let units = |z: &f32| (f64::from(*z) / unit).round() as u16;
        // What does not fit is out of range.
        let fits = |z: &f32| if f64::from(*z) / unit <= LARGEST_UNITS { *z } else { 0.0 };
        let units = depth.iter().map(|z| units(&fits(z)));
        let units = units_png(camera.width, camera.height, units).map_err(failed)?;
        let rgb = rgb_jpeg(camera.width, camera.height, &rgb).map_err(failed)?;
        Ok(RgbdFrame {
            color: Color { format: ColorFormat::Jpeg, bytes: rgb },
            depth: Depth { format: DepthFormat::Png16, bytes: units },
            ..frame
        })
    }

    fn simulated(&self) -> Option<String> {
        let before = self.dataset.simulated().map(|words| words + ", ");
        let before = before.unwrap_or_default();
        Some(format!("{before}sensor {} with seed {}", self.preset.name, self.seed))
    }
}
