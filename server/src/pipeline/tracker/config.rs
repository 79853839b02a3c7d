//! Settings of the tracker, section `[tracker]`.

use super::super::range::{
    MAX_COLUMNS, MAX_COUNT, MAX_PIXELS, OutOfRange, above, at_least, require, within,
};
use serde::{Deserialize, Serialize};

/// Largest step of a refined pose or exposure.
const MAX_STEP: f64 = 1.0;
/// Most levels of a pyramid.
const MAX_LEVELS: usize = 16;

/// How poses are estimated where they are not given. Whether a pose is right follows from what contradicts it
/// (`*_disagreement`, `*_factor`). The shares before those only ask that enough is compared: right poses had
/// an overlap of at least 0.75, and their surface was 0.26 (simulated stereo), 0.37 (time of flight), 0.47
/// (Kinect) and 0.69 (rendered).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackerConfig {
    /// The method of alignment.
    pub method: TrackerMethod,
    /// Frames are tracked at this many columns at most.
    pub width: u32,
    /// Most Gauss-Newton steps at each level of the pyramid, finest first.
    pub steps: Vec<usize>,
    /// The same for an initial pose that may be far off.
    pub wide_steps: Vec<usize>,
    /// About the number of pixels that are compared at the finest level, with all references together; half
    /// as many at each coarser level.
    pub pixels: usize,
    /// Weight of the photometric term, 1 / intensity².
    pub photometric_weight: f64,
    /// Weight of the geometric term, 1 / metres².
    pub geometric_weight: f64,
    /// Standard deviation of a depth of one metre, metres. It grows with the square of the depth.
    pub depth_noise: f64,
    /// Weight of the rendered map beside keyframes; 0: it is only a reference where there are no keyframes.
    pub map_weight: f64,
    /// Number of keyframes that are references: the newest, and the oldest in view.
    pub keyframes: usize,
    /// A keyframe is in view if a camera at the predicted pose sees at least this share of it.
    pub keyframe_overlap: f64,
    /// Whether each frame's exposure is estimated, as a gain.
    pub exposure: bool,
    /// The frame is aligned again if its pose moved by more than this from the initial pose, metres,
    pub rerender_metres: f64,
    /// or turned by more than this, radians.
    pub rerender_radians: f64,
    /// Number of neighbouring pixels that are as informative as one independent measurement. It weighs the
    /// robot's own estimate against the images.
    pub correlated_pixels: f64,
    /// Tracked if at least this share of the measured pixels projects into the reference,
    pub min_overlap: f64,
    /// and at least this share of those lies on the reference's surface,
    pub min_surface: f64,
    /// and at least this share of the compared pixels has the reference's intensity,
    pub min_intensity: f64,
    /// and the smallest eigenvalue of the normal system is at least this share of the largest.
    pub min_conditioning: f64,
    /// Most share of the pixels that may contradict the reference if no other start is to be tried,
    pub convincing_disagreement: f64,
    /// or this times the share that tracked frames usually leave unexplained, whichever is more.
    pub convincing_factor: f64,
    /// Most share of the pixels that may contradict the reference if a pose is to be believed. Of a pose that
    /// two starts confirm, it is the most share that may contradict it in depth, whatever its colors.
    pub max_disagreement: f64,
    /// A pose is also believed with this times the usual share.
    pub max_factor: f64,
    /// Most share if two starts end at one pose and one of them is from features.
    pub confirmed_disagreement: f64,
    /// Number of similar keyframes that a lost frame is aligned with; 0: only with the last pose.
    pub relocalise_keyframes: usize,
    /// Relocalised if at least this share of the compared pixels has the map's intensity.
    pub relocalise_intensity: f64,
    /// and the smallest eigenvalue of the normal system is at least this share of the largest: at a blank
    /// wall, nothing tells one place from another.
    pub relocalise_conditioning: f64,
    /// Poses of this many newest keyframes are refined with the map. 0: none, because a young map is less
    /// exact than the poses (measured).
    pub refine_keyframes: usize,
    /// Step of a refined position, metres.
    pub refine_metres: f64,
    /// Step of a refined rotation, radians.
    pub refine_radians: f64,
    /// Step of a refined exposure.
    pub refine_exposure: f64,
    /// Settings of the method `photometric`.
    pub photometric: PhotometricConfig,
}

/// The method of alignment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrackerMethod {
    /// A few Gauss-Newton steps against images of keyframes.
    GaussNewton,
    /// The paper's: many steps of Adam, each against a rendered image of the map. It never reports a lost
    /// frame.
    Photometric,
}

/// The paper's tracker, with the constants of its code.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PhotometricConfig {
    /// Most steps for a frame.
    pub iterations: usize,
    /// Step of the position, metres.
    pub metres: f64,
    /// Step of the rotation, radians.
    pub radians: f64,
    /// Step of the exposure.
    pub exposure: f64,
    /// The steps end when one of them, [rho, theta], is shorter than this.
    pub converged: f64,
    /// Weight of the L1 of color, channels 0 to 1.
    pub color: f32,
    /// Weight of the L1 of depth, per metre.
    pub depth: f32,
}

impl TrackerConfig {
    /// Checks the range of each number.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        within("tracker.width", self.width, 1..=MAX_COLUMNS)?;
        let levels = |key, steps: &[usize]| {
            let found = format!("{steps:?}");
            let fits = (1..=MAX_LEVELS).contains(&steps.len())
                && steps.iter().all(|steps| *steps <= MAX_COUNT);
            let expected = format!("steps of 1 to {MAX_LEVELS} levels, each at most {MAX_COUNT}");
            require(fits, key, found, expected)
        };
        levels("tracker.steps", &self.steps)?;
        levels("tracker.wide_steps", &self.wide_steps)?;
        within("tracker.pixels", self.pixels, 1..=MAX_PIXELS as usize)?;
        within("tracker.keyframes", self.keyframes, 0..=MAX_COUNT)?;
        within("tracker.relocalise_keyframes", self.relocalise_keyframes, 0..=MAX_COUNT)?;
        within("tracker.refine_keyframes", self.refine_keyframes, 0..=MAX_COUNT)?;
        at_least("tracker.photometric_weight", self.photometric_weight, 0.0)?;
        at_least("tracker.geometric_weight", self.geometric_weight, 0.0)?;
        at_least("tracker.depth_noise", self.depth_noise, 0.0)?;
        at_least("tracker.map_weight", self.map_weight, 0.0)?;
        within("tracker.keyframe_overlap", self.keyframe_overlap, 0.0..=1.0)?;
        at_least("tracker.rerender_metres", self.rerender_metres, 0.0)?;
        at_least("tracker.rerender_radians", self.rerender_radians, 0.0)?;
        at_least("tracker.correlated_pixels", self.correlated_pixels, 0.0)?;
        within("tracker.min_overlap", self.min_overlap, 0.0..=1.0)?;
        within("tracker.min_surface", self.min_surface, 0.0..=1.0)?;
        within("tracker.min_intensity", self.min_intensity, 0.0..=1.0)?;
        within("tracker.min_conditioning", self.min_conditioning, 0.0..=1.0)?;
        within("tracker.convincing_disagreement", self.convincing_disagreement, 0.0..=1.0)?;
        at_least("tracker.convincing_factor", self.convincing_factor, 0.0)?;
        within("tracker.max_disagreement", self.max_disagreement, 0.0..=1.0)?;
        at_least("tracker.max_factor", self.max_factor, 0.0)?;
        within("tracker.confirmed_disagreement", self.confirmed_disagreement, 0.0..=1.0)?;
        within("tracker.relocalise_intensity", self.relocalise_intensity, 0.0..=1.0)?;
        within("tracker.relocalise_conditioning", self.relocalise_conditioning, 0.0..=1.0)?;
        within("tracker.refine_metres", self.refine_metres, 0.0..=MAX_STEP)?;
        within("tracker.refine_radians", self.refine_radians, 0.0..=MAX_STEP)?;
        within("tracker.refine_exposure", self.refine_exposure, 0.0..=MAX_STEP)?;
        self.photometric.check()
    }
}

impl PhotometricConfig {
    fn check(&self) -> Result<(), OutOfRange> {
        within("tracker.photometric.iterations", self.iterations, 1..=MAX_COUNT)?;
        within("tracker.photometric.metres", self.metres, 0.0..=MAX_STEP)?;
        within("tracker.photometric.radians", self.radians, 0.0..=MAX_STEP)?;
        within("tracker.photometric.exposure", self.exposure, 0.0..=MAX_STEP)?;
        above("tracker.photometric.converged", self.converged, 0.0)?;
        at_least("tracker.photometric.color", self.color, 0.0)?;
        at_least("tracker.photometric.depth", self.depth, 0.0)
    }
}

impl Default for TrackerConfig {
    fn default() -> Self {
        Self {
            method: TrackerMethod::GaussNewton,
            width: 640,
            steps: vec![3, 4, 6],
            wide_steps: vec![4, 6, 10, 10],
            pixels: 96_000,
            photometric_weight: 400.0,
            geometric_weight: 1e4,
            depth_noise: 0.0007,
            map_weight: 0.0,
            keyframes: 3,
            keyframe_overlap: 0.6,
            exposure: true,
            rerender_metres: 0.05,
            rerender_radians: 0.05,
            correlated_pixels: 50.0,
            min_overlap: 0.3,
            min_surface: 0.1,
            min_intensity: 0.55,
            min_conditioning: 1e-4,
            convincing_disagreement: 0.03,
            convincing_factor: 2.0,
            max_disagreement: 0.05,
            max_factor: 4.0,
            confirmed_disagreement: 0.4,
            relocalise_keyframes: 4,
            relocalise_intensity: 0.6,
            relocalise_conditioning: 6e-4,
            refine_keyframes: 0,
            refine_metres: 5e-4,
            refine_radians: 1.5e-3,
            refine_exposure: 0.01,
            photometric: PhotometricConfig::default(),
        }
    }
}

impl Default for PhotometricConfig {
    fn default() -> Self {
        Self {
            iterations: 100,
            metres: 1e-3,
            radians: 3e-3,
            exposure: 0.01,
            converged: 1e-4,
            color: 0.95,
            depth: 0.05,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::range::table::{Case, assert_checks};
    use super::*;

    const CASES: &[Case<TrackerConfig>] = &[
        ("tracker.keyframes", |c| c.keyframes = MAX_COUNT + 1, |c| c.keyframes = 0),
        (
            "tracker.relocalise_keyframes",
            |c| c.relocalise_keyframes = MAX_COUNT + 1,
            |c| c.relocalise_keyframes = 0,
        ),
        (
            "tracker.refine_keyframes",
            |c| c.refine_keyframes = MAX_COUNT + 1,
            |c| c.refine_keyframes = 0,
        ),
        ("tracker.steps", |c| c.steps = vec![1; MAX_LEVELS + 1], |c| c.steps = vec![1; MAX_LEVELS]),
        ("tracker.wide_steps", |c| c.wide_steps = vec![MAX_COUNT + 1], |c| c.wide_steps = vec![1]),
        ("tracker.width", |c| c.width = 0, |c| c.width = 1),
        ("tracker.steps", |c| c.steps = Vec::new(), |c| c.steps = vec![1]),
        ("tracker.wide_steps", |c| c.wide_steps = Vec::new(), |c| c.wide_steps = vec![1]),
        ("tracker.pixels", |c| c.pixels = 0, |c| c.pixels = 1),
        (
            "tracker.photometric_weight",
            |c| c.photometric_weight = -1.0,
            |c| c.photometric_weight = 0.0,
        ),
        (
            "tracker.geometric_weight",
            |c| c.geometric_weight = f64::NAN,
            |c| c.geometric_weight = 0.0,
        ),
        ("tracker.depth_noise", |c| c.depth_noise = -1.0, |c| c.depth_noise = 0.0),
        ("tracker.map_weight", |c| c.map_weight = f64::INFINITY, |c| c.map_weight = 1.0),
        ("tracker.keyframe_overlap", |c| c.keyframe_overlap = 1.1, |c| c.keyframe_overlap = 1.0),
        ("tracker.rerender_metres", |c| c.rerender_metres = -1.0, |c| c.rerender_metres = 0.0),
        (
            "tracker.rerender_radians",
            |c| c.rerender_radians = f64::NAN,
            |c| c.rerender_radians = 0.0,
        ),
        (
            "tracker.correlated_pixels",
            |c| c.correlated_pixels = -1.0,
            |c| c.correlated_pixels = 0.0,
        ),
        ("tracker.min_overlap", |c| c.min_overlap = 1.1, |c| c.min_overlap = 1.0),
        ("tracker.min_surface", |c| c.min_surface = -0.1, |c| c.min_surface = 0.0),
        ("tracker.min_intensity", |c| c.min_intensity = f64::NAN, |c| c.min_intensity = 0.0),
        ("tracker.min_conditioning", |c| c.min_conditioning = 1.1, |c| c.min_conditioning = 0.0),
        (
            "tracker.convincing_disagreement",
            |c| c.convincing_disagreement = 1.1,
            |c| c.convincing_disagreement = 0.0,
        ),
        (
            "tracker.convincing_factor",
            |c| c.convincing_factor = -1.0,
            |c| c.convincing_factor = 0.0,
        ),
        ("tracker.max_disagreement", |c| c.max_disagreement = -0.1, |c| c.max_disagreement = 1.0),
        (
            "tracker.confirmed_disagreement",
            |c| c.confirmed_disagreement = 1.1,
            |c| c.confirmed_disagreement = 0.0,
        ),
        ("tracker.max_factor", |c| c.max_factor = f64::NAN, |c| c.max_factor = 0.0),
        (
            "tracker.relocalise_intensity",
            |c| c.relocalise_intensity = -0.1,
            |c| c.relocalise_intensity = 0.0,
        ),
        (
            "tracker.relocalise_conditioning",
            |c| c.relocalise_conditioning = 1.1,
            |c| c.relocalise_conditioning = 0.0,
        ),
        ("tracker.refine_metres", |c| c.refine_metres = 2.0, |c| c.refine_metres = 0.0),
        ("tracker.refine_radians", |c| c.refine_radians = -1.0, |c| c.refine_radians = 0.0),
        ("tracker.refine_exposure", |c| c.refine_exposure = f64::NAN, |c| c.refine_exposure = 0.0),
        (
            "tracker.photometric.iterations",
            |c| c.photometric.iterations = 0,
            |c| c.photometric.iterations = 1,
        ),
        (
            "tracker.photometric.metres",
            |c| c.photometric.metres = 2.0,
            |c| c.photometric.metres = 0.0,
        ),
        (
            "tracker.photometric.radians",
            |c| c.photometric.radians = -1.0,
            |c| c.photometric.radians = 0.0,
        ),
        (
            "tracker.photometric.exposure",
            |c| c.photometric.exposure = f64::NAN,
            |c| c.photometric.exposure = 0.0,
        ),
        (
            "tracker.photometric.converged",
            |c| c.photometric.converged = 0.0,
            |c| c.photometric.converged = 1e-9,
        ),
        (
            "tracker.photometric.color",
            |c| c.photometric.color = -1.0,
            |c| c.photometric.color = 0.0,
        ),
        (
            "tracker.photometric.depth",
            |c| c.photometric.depth = f32::NAN,
            |c| c.photometric.depth = 0.0,
        ),
    ];

    #[test]
    fn each_number_is_checked() {
        assert_checks("tracker", TrackerConfig::check, CASES, &[]);
    }
}
