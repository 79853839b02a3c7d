//! Whether an estimated pose is accepted.
//!
//! In: a frame, or how well it agrees with its reference after alignment. Out: yes or no. Thresholds are
//! settings. All comparisons are phrased so that a NaN is rejected.

use super::super::downsampled_frame::DownsampledFrame;
use super::config::TrackerConfig;
use lexsplat_gpu::NormalSystem;
use serde::{Deserialize, Serialize};

/// A frame with a smaller share of measured pixels is neither tracked nor mapped.
const MIN_MEASURED: f64 = 0.03;
/// A frame with a smaller mean intensity is black, 0 to 255.
const BLACK: f64 = 6.0;
/// Mean of a dark frame, 0 to 255.
const DARK: f64 = 16.0;

/// One in so many pixels tells the brightness of a frame and how much of it is measured.
const LOOKED_AT: usize = 7;
/// Colors that are neither black nor blown out.
const USABLE_COLOR: std::ops::Range<u8> = 4..252;

/// How well a frame agrees with its reference after alignment. All shares are 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct AlignmentQuality {
    /// Share of the measured pixels that project into the reference.
    pub overlap: f64,
    /// Share of those that lie on the reference's surface.
    pub surface: f64,
    /// Share of the compared pixels that have the reference's intensity.
    pub intensity: f64,
    /// Share of the pixels on surfaces that both images show that agree in depth and intensity, in the
    /// direction in which it is smaller. A pixel that lies in front of the other image's surface
    /// contradicts it; one that lies behind is hidden and does not count.
    pub agreement: f64,
    /// The same share with agreement in depth alone.
    pub depth_agreement: f64,
    /// Smallest over largest eigenvalue of the normal system.
    pub conditioning: f64,
}

impl AlignmentQuality {
    /// That of a pose that is not in doubt.
    pub const PERFECT: Self = Self {
        overlap: 1.0,
        surface: 1.0,
        intensity: 1.0,
        agreement: 1.0,
        depth_agreement: 1.0,
        conditioning: 1.0,
    };

    /// Quality from the system with respect to the best reference, and from the same two images with
    /// their roles exchanged.
    pub fn of(system: Option<&NormalSystem>, exchanged: &NormalSystem, conditioning: f64) -> Self {
        let counts = system.map(|system| system.counts).unwrap_or_default();
        let other = &exchanged.counts;
        Self {
            overlap: share(counts.inside, counts.live),
            surface: share(counts.geometric_inliers, counts.inside),
            intensity: share(counts.photometric_inliers, counts.photometric),
            agreement: share(counts.agreeing, counts.visible)
                .min(share(other.agreeing, other.visible)),
            depth_agreement: share(counts.meeting, counts.visible)
                .min(share(other.meeting, other.visible)),
            conditioning,
        }
    }

    /// Whether the geometry fits.
    pub fn is_aligned(&self, config: &TrackerConfig) -> bool {
        self.overlap >= config.min_overlap
            && self.surface >= config.min_surface
            && self.conditioning >= config.min_conditioning
    }

    /// Good enough for a frame that was predicted.
    pub fn is_tracked(&self, config: &TrackerConfig) -> bool {
        self.is_aligned(config) && self.intensity >= config.min_intensity
    }

    /// Good enough for a pose that started from a guess.
    pub fn is_relocalised(&self, config: &TrackerConfig) -> bool {
        self.is_tracked(config)
            && self.intensity >= config.relocalise_intensity
            && self.conditioning >= config.relocalise_conditioning
    }
}

/// Index of the reference that the frame agrees with best.
pub(super) fn best(systems: &[NormalSystem]) -> Option<usize> {
    let agreement = |system: &NormalSystem| {
        let counts = &system.counts;
        share(counts.inside, counts.live) * share(counts.geometric_inliers, counts.inside)
    };
    (0..systems.len()).max_by(|a, b| agreement(&systems[*a]).total_cmp(&agreement(&systems[*b])))
}

fn share(part: u32, whole: u32) -> f64 {
    f64::from(part) / f64::from(whole.max(1))
}

/// Color and depth of the pixels that tell how good a frame is.
fn sample(frame: &DownsampledFrame) -> impl Iterator<Item = (&[u8], f32)> {
    let depths = &*frame.depth_metres;
    let pixels = (0..depths.len()).step_by(LOOKED_AT);
    pixels.map(|pixel| (&frame.rgb[3 * pixel..3 * pixel + 3], depths[pixel]))
}

/// Share of the pixels that have a depth and are neither black nor blown out, 0 to 1.
pub(super) fn usable_share(frame: &DownsampledFrame) -> f64 {
    share_of(frame, |rgb, depth| {
        depth > 0.0 && rgb.iter().any(|value| USABLE_COLOR.contains(value))
    })
}

/// Whether a frame is black or hardly measured, so that it can be neither tracked nor mapped.
pub(super) fn is_blank(frame: &DownsampledFrame) -> bool {
    let is_measured = share_of(frame, |_, depth| depth > 0.0) >= MIN_MEASURED;
    !is_measured || brightness(frame) < BLACK
}

/// Share of the pixels of which this is true, 0 to 1.
fn share_of(frame: &DownsampledFrame, is_true: impl Fn(&[u8], f32) -> bool) -> f64 {
    let (mut all, mut count) = (0, 0);
    for (rgb, depth) in sample(frame) {
        all += 1;
        count += u32::from(is_true(rgb, depth));
    }
    share(count, all)
}

/// Whether a frame is so dark that its colors say little: of a camera that has just been switched on.
pub(super) fn is_dark(frame: &DownsampledFrame) -> bool {
    brightness(frame) < DARK
}

/// Mean of all channels, 0 to 255.
fn brightness(frame: &DownsampledFrame) -> f64 {
    let (mut values, mut light) = (0, 0);
    for (rgb, _) in sample(frame) {
        values += 3;
        light += rgb.iter().map(|value| u64::from(*value)).sum::<u64>();
    }
    light as f64 / f64::from(values.max(1))
}
