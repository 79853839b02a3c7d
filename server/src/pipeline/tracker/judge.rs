//! Is this pose to be believed? In: a frame, or how well it agrees with its reference. Out: yes or
//! no. Thresholds are settings; all are phrased so that a NaN is no.

use super::super::working::Working;
use super::TrackerConfig;
use lexsplat_gpu::NormalSystem;

/// A frame with less of it measured tells no pose, and maps nothing.
const MIN_MEASURED: f64 = 0.03;
/// A frame that is darker on average shows nothing, of 255.
const BLACK: f64 = 6.0;

/// How well a frame agrees with its reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Evidence {
    /// Share of the measured pixels that falls into the reference.
    pub overlap: f64,
    /// Share of those that lies on the reference's surface.
    pub surface: f64,
    /// Share of the compared pixels that has the reference's intensity.
    pub intensity: f64,
    /// Weight of the least visible motion over that of the most visible one.
    pub conditioning: f64,
}

impl Evidence {
    /// Of an alignment: by the reference that the frame agrees with best.
    pub fn of(systems: &[NormalSystem], conditioning: f64) -> Self {
        let share = |part: u32, whole: u32| f64::from(part) / f64::from(whole.max(1));
        let evidence = |system: &NormalSystem| {
            let counts = &system.counts;
            Self {
                overlap: share(counts.inside, counts.live),
                surface: share(counts.geometric_inliers, counts.inside),
                intensity: share(counts.photometric_inliers, counts.photometric),
                conditioning,
            }
        };
        let all = systems.iter().map(evidence);
        let agreement = |evidence: &Self| evidence.overlap * evidence.surface;
        let best = all.max_by(|a, b| agreement(a).total_cmp(&agreement(b)));
        best.unwrap_or(Self { overlap: 0.0, surface: 0.0, intensity: 0.0, conditioning })
    }

    /// Enough to go on with.
    pub fn is_tracked(&self, config: &TrackerConfig) -> bool {
        self.overlap >= config.min_overlap
            && self.surface >= config.min_surface
            && self.intensity >= config.min_intensity
            && self.conditioning >= config.min_conditioning
    }

    /// Enough to believe it of a place that was only guessed.
    pub fn is_found_again(&self, config: &TrackerConfig) -> bool {
        self.is_tracked(config)
            && self.surface >= config.relocalise_surface
            && self.intensity >= config.relocalise_intensity
    }
}

/// Whether there is nothing in a frame that could be tracked or mapped: black, or hardly measured.
pub(in super::super) fn is_blank(working: &Working) -> bool {
    let measured = working.depth_metres.iter().filter(|depth| **depth > 0.0).count();
    let light: u64 = working.rgb.iter().map(|value| u64::from(*value)).sum();
    let is_measured = measured as f64 >= MIN_MEASURED * working.depth_metres.len() as f64;
    !is_measured || (light as f64) < BLACK * working.rgb.len() as f64
}
