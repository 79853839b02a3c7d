//! Input and report of a training step.

use crate::device::{GpuError, expect_len};
use crate::pass::{Camera, HeadCameras};
use crate::shader::layout::{HitCount, Row};
use crate::train::adam::LearningRates;
use crate::train::focus::Focus;
use crate::train::loss::{LossWeights, Losses};
use crate::train::target::{ColorTarget, LanguageTarget};

/// Rows of the results of a step; see [`StepReport::from_rows`].
pub(super) const RESULT_ROWS: usize = 6;
/// Row of the color and depth terms and of dL/d(a, b).
pub(super) const COLOR_ROW: u32 = 0;
/// Row of the language term.
pub(super) const LANGUAGE_ROW: u32 = 1;
/// Row of the isotropy term.
pub(super) const ISOTROPIC_ROW: u32 = 2;
/// Row of the term that ties language scales to color scales.
pub(super) const TIE_ROW: u32 = 3;
/// Row of dL/drho of the camera; dL/dtheta follows.
pub(super) const POSE_ROW: u32 = 4;
/// Bytes of a step's read-back: the results, and the hit counts of both heads.
pub(super) const REPORT_BYTES: u64 =
    (RESULT_ROWS * size_of::<Row>() + 2 * size_of::<HitCount>()) as u64;

/// One view to learn from. The language camera has the label map's resolution and the same pose.
#[derive(Clone, Copy)]
pub struct TrainingView<'a> {
    /// Camera of the color target.
    pub camera: &'a Camera,
    /// Color and depth, if they are to be learned.
    pub color: Option<&'a ColorTarget>,
    /// Language codes with their camera, if they are to be learned.
    pub language: Option<(&'a Camera, &'a LanguageTarget)>,
    /// Exposure (a, b): the target shows exp(a) color + b.
    pub exposure: [f32; 2],
    /// Which tiles of the color target the step looks at; `None`: all.
    pub focus: Option<Focus>,
}

/// Measurements of a step, taken before the optimiser moved anything.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepReport {
    /// Terms of the loss.
    pub losses: Losses,
    /// dL/dtau of the color and depth terms with tau = (rho, theta), a left perturbation of
    /// `camera_from_world`: per metre and per radian.
    pub pose_gradient: [f32; 6],
    /// dL/d(a, b) of the exposure.
    pub exposure_gradient: [f32; 2],
}

/// A step with everything it needs, kept until the step is known to have been taken.
#[derive(Clone)]
pub(super) struct StepJob {
    pub(super) camera: Camera,
    pub(super) color: Option<ColorTarget>,
    pub(super) language: Option<(Camera, LanguageTarget)>,
    pub(super) exposure: [f32; 2],
    pub(super) focus: Option<Focus>,
    pub(super) weights: LossWeights,
    /// `None` leaves the map as it is: only the report is wanted.
    pub(super) rates: Option<LearningRates>,
}

impl TrainingView<'_> {
    /// Returns an error unless cameras, targets and the length of a code agree.
    pub(super) fn check(&self, channels: usize) -> Result<(), GpuError> {
        if let Some(target) = self.color {
            check_size(self.camera, target.size())?;
        }
        if let Some((camera, target)) = self.language {
            check_size(camera, target.size())?;
            expect_len("target channels", channels, target.inner().channels)?;
        }
        if !self.exposure.iter().all(|value| value.is_finite()) {
            let found = format!("{:?}", self.exposure);
            return Err(GpuError::BadValue { what: "exposure", expected: "finite numbers", found });
        }
        Ok(())
    }
}

impl StepJob {
    pub(super) fn new(
        view: &TrainingView<'_>,
        weights: LossWeights,
        rates: Option<LearningRates>,
    ) -> Self {
        Self {
            camera: view.camera.clone(),
            color: view.color.cloned(),
            language: view.language.map(|(camera, target)| (camera.clone(), target.clone())),
            exposure: view.exposure,
            focus: view.focus,
            weights,
            rates,
        }
    }

    pub(super) fn cameras(&self) -> HeadCameras<'_> {
        HeadCameras {
            color: self.color.as_ref().map(|_| &self.camera),
            language: self.language.as_ref().map(|(camera, _)| camera),
        }
    }
}

impl StepReport {
    pub(super) fn from_rows(rows: &[Row]) -> Self {
        let row = |row: u32| rows[row as usize];
        let (color, rho, theta) = (row(COLOR_ROW), row(POSE_ROW), row(POSE_ROW + 1));
        Self {
            losses: Losses {
                color: color[0],
                depth: color[1],
                language: row(LANGUAGE_ROW)[0],
                isotropic: row(ISOTROPIC_ROW)[0],
                tie: row(TIE_ROW)[0],
            },
            pose_gradient: [rho[0], rho[1], rho[2], theta[0], theta[1], theta[2]],
            exposure_gradient: [color[2], color[3]],
        }
    }
}

fn check_size(camera: &Camera, [width, height]: [u32; 2]) -> Result<(), GpuError> {
    camera.check()?;
    expect_len("target width", camera.width as usize, width as usize)?;
    expect_len("target height", camera.height as usize, height as usize)
}
