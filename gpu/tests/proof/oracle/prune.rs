//! Reference, not for production: which Gaussians stay, in `f32` because comparisons must agree
//! exactly.

use lexsplat_gpu::HostGaussians;
use lexsplat_gpu::shader::layout::{HUGE, PruneArguments};

/// The indices of the Gaussians that stay, in order.
pub fn kept(map: &HostGaussians, arguments: &PruneArguments) -> Vec<u32> {
    let stays = |i: &u32| {
        let i = *i as usize;
        let opaque = map.color.opacity_logits[i] >= arguments.min_logit
            || map.language.opacity_logits[i] >= arguments.min_logit;
        let has_size = map.color.log_scales[i].iter().all(|scale| *scale < HUGE);
        let has_place = map.means[i].iter().all(|metres| metres.abs() < HUGE);
        opaque && has_size && has_place
    };
    (0..map.len() as u32).filter(stays).collect()
}
