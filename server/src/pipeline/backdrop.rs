//! What a frame shows and did not measure: out of the sensor's range, through glass, in the shadow of
//! an edge.
//!
//! Left open, it is black, and what surrounds it grows into it until the map is full of haze. It gets
//! Gaussians behind everything that was measured: whatever is measured later stands in front of them.
//! They have color and no language: a place that nobody knows is no answer to "where". So they are
//! known by the opacity of their language heads, which no optimiser step changes, because no pixel sees
//! them.

use super::working::Working;
use lexsplat_gpu::{HostGaussians, HostHead};

/// Logit of the language opacity of what has no known place: nothing, and far from what optimising reaches.
pub(super) const NOWHERE: f32 = -30.0;

/// The picture with so many metres wherever nothing was measured.
pub(super) fn filled(working: &Working, metres: f32) -> Working {
    let fill = |depth: &f32| if *depth > 0.0 { *depth } else { metres };
    Working { depth_metres: working.depth_metres.iter().map(fill).collect(), ..working.clone() }
}

/// Whether a Gaussian with this logit of its language opacity is of a backdrop.
pub(super) fn is_of_backdrop(language_logit: f32) -> bool {
    language_logit < NOWHERE / 2.0
}

/// The map without backdrops: what has a place that was measured.
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
