//! The tracker's settings, section `[tracker]`.

use serde::{Deserialize, Serialize};

/// How poses are estimated where they are not given. The thresholds stand between what was measured
/// over 300 frames of a real walk (least: overlap 0.80, surface 0.48, intensity 0.83, conditioning 0.005)
/// and where the loop ended at wrong poses (surface 0.39 with intensity 0.41; of a negative, 0.58 and 0.51); measured
/// before normals were left out where depth bends.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackerConfig {
    /// How.
    pub method: TrackerMethod,
    /// Frames are tracked at this many columns at most.
    pub width: u32,
    /// Most Gauss-Newton steps per level of the pyramid, finest first.
    pub steps: Vec<usize>,
    /// The same for a start that may be far off.
    pub wide_steps: Vec<usize>,
    /// About so many pixels of the finest level are compared at most; all of the others'.
    pub pixels: usize,
    /// Of the photometric term, 1 / intensity².
    pub photometric_weight: f64,
    /// Of the geometric term, 1 / metres².
    pub geometric_weight: f64,
    /// Standard deviation of a depth of one metre, metres; it grows with the depth squared.
    pub depth_noise: f64,
    /// How much the rendered map counts beside keyframes; 0: it is rendered only without them.
    pub map_weight: f64,
    /// Keyframes whose own pictures are references too: the newest, and the oldest in sight.
    pub keyframes: usize,
    /// In sight: a camera at the predicted pose sees at least this share of the keyframe.
    pub keyframe_overlap: f64,
    /// Whether the exposure of each frame is estimated: a gain.
    pub exposure: bool,
    /// The map is rendered a second time when the pose moved by more than this, metres.
    pub rerender_metres: f64,
    /// The same for turns, radians.
    pub rerender_radians: f64,
    /// Pixels that tell as much as one measurement would that is independent of all others: by so
    /// much counts what the robot thinks of its pose against what it sees.
    pub correlated_pixels: f64,
    /// Tracked if at least this share of the measured pixels falls into the reference.
    pub min_overlap: f64,
    /// Tracked if at least this share of those lies on the reference's surface.
    pub min_surface: f64,
    /// Tracked if at least this share of the compared pixels has the reference's intensity.
    pub min_intensity: f64,
    /// Tracked if the least visible motion is seen by this share of the most visible one's weight.
    pub min_conditioning: f64,
    /// Keyframes that are tried when the camera is lost; 0: it stays where it was lost.
    pub relocalise_keyframes: usize,
    /// Found again if at least this share of the pixels in sight lies on the surface.
    pub relocalise_surface: f64,
    /// Found again if at least this share of the compared pixels has the map's intensity.
    pub relocalise_intensity: f64,
    /// Poses of this many newest keyframes are refined with the map; 0: none (measured: a young map
    /// is less exact than the poses, so that they get worse).
    pub refine_keyframes: usize,
    /// Step of a refined pose, metres.
    pub refine_metres: f64,
    /// Step of a refined pose, radians.
    pub refine_radians: f64,
    /// Step of a refined exposure.
    pub refine_exposure: f64,
    /// Of the method `photometric`.
    pub photometric: PhotometricConfig,
}

/// How poses are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrackerMethod {
    /// Few Gauss-Newton steps on pictures of keyframes.
    GaussNewton,
    /// The paper's: many steps of Adam, each on a picture of the map. It never says that it is lost.
    Photometric,
}

/// The paper's tracker, with the constants of its code.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PhotometricConfig {
    /// Steps at most.
    pub iterations: usize,
    /// Step of the position, metres.
    pub metres: f64,
    /// Step of the rotation, radians.
    pub radians: f64,
    /// Step of the exposure.
    pub exposure: f64,
    /// It ends when a step [rho, theta] is shorter than this.
    pub converged: f64,
    /// Weight of the L1 of color.
    pub color: f32,
    /// Weight of the L1 of depth, per metre.
    pub depth: f32,
}

impl Default for TrackerConfig {
    fn default() -> Self {
        Self {
            method: TrackerMethod::GaussNewton,
            width: 640,
            steps: vec![3, 4, 6],
            wide_steps: vec![4, 6, 10, 10],
            pixels: 64_000,
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
            min_surface: 0.3,
            min_intensity: 0.55,
            min_conditioning: 1e-4,
            relocalise_keyframes: 4,
            relocalise_surface: 0.5,
            relocalise_intensity: 0.7,
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
