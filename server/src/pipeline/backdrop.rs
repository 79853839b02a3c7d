//! The backdrop: Gaussians for pixels that have color but no depth.
//!
//! Depth is missing out of the sensor's range, behind glass and in the shadow of an edge. Without Gaussians
//! of their own such pixels are black, and the optimiser grows their neighbours into them until the map is
//! full of haze. So they get Gaussians behind everything that was measured: whatever is measured later
//! stands in front of them.
//!
//! Backdrop Gaussians have color and no language, because their place is a guess. They are recognised by the
//! opacity of their language head. No optimiser step changes it, because no pixel sees that head.

use super::downsampled_frame::DownsampledFrame;
use lexsplat_gpu::{HostGaussians, HostHead};

/// Logit of the language opacity of a backdrop Gaussian: fully transparent, far below what optimisation
/// reaches.
pub(super) const BACKDROP_LOGIT: f32 = -30.0;

/// Logit of the language opacity of a Gaussian that adds detail to the color of a place that has language
/// already: transparent, below what optimisation reaches, and no backdrop.
pub(super) const DETAIL_LOGIT: f32 = -10.0;

/// Whether a Gaussian with this language opacity logit can show language.
pub(super) fn can_have_language(language_logit: f32) -> bool {
    language_logit > DETAIL_LOGIT + 0.5
}

/// The frame with a depth of `metres` wherever nothing was measured.
pub(super) fn filled(frame: &DownsampledFrame, metres: f32) -> DownsampledFrame {
    let fill = |depth: &f32| if *depth > 0.0 { *depth } else { metres };
    let depth_metres = frame.depth_metres.iter().map(fill).collect();
    DownsampledFrame { depth_metres, ..frame.clone() }
}

/// Whether a Gaussian with this language opacity logit belongs to the backdrop.
pub(super) fn is_of_backdrop(language_logit: f32) -> bool {
    language_logit < BACKDROP_LOGIT / 2.0
}

/// A copy of the map without its backdrop.
pub(super) fn without(map: &HostGaussians) -> HostGaussians {
    let logits = &map.language.opacity_logits;
    let kept: Vec<usize> = (0..map.len()).filter(|&at| !is_of_backdrop(logits[at])).collect();
    let head = |head: &HostHead| HostHead {
        rotations: kept.iter().map(|&at| head.rotations[at]).collect(),
        log_scales: kept.iter().map(|&at| head.log_scales[at]).collect(),
        opacity_logits: kept.iter().map(|&at| head.opacity_logits[at]).collect(),
        features: kept
            .iter()
            .flat_map(|&at| &head.features[at * head.channels..][..head.channels])
            .copied()
            .collect(),
        channels: head.channels,
    };
    HostGaussians {
        means: kept.iter().map(|&at| map.means[at]).collect(),
        color: head(&map.color),
        language: head(&map.language),
    }
}
