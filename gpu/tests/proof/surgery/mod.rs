//! Surgery on a map: decisions and orders exactly as the oracle has them, children as the
//! covariance wants them, and training that does not notice who was removed.

mod children;
mod densify;
mod morton;
mod retain;
mod speed;

use lexsplat_gpu::{DensifyRules, Gaussians, Gpu, HostGaussians, HostHead};

const LENGTHS: [usize; 9] = [0, 1, 2, 63, 64, 65, 1023, 1025, 5003];
const CHANNELS: usize = 5;
/// Limits that scenes of 5 cm Gaussians have on both sides.
const RULES: DensifyRules = DensifyRules {
    min_gradient: 2e-4,
    clone_scale: 0.08,
    min_opacity: 0.3,
    max_scale: Some(0.095),
    either_head: false,
    max_radius: Some(40.0),
    max_gaussians: usize::MAX,
    seed: 7,
};

fn map(gpu: &Gpu, host: &HostGaussians) -> Gaussians {
    let mut map = Gaussians::new(gpu, host.language.channels);
    map.append(host).expect("fits");
    map
}

/// The chosen Gaussians of a map, in the order of `index`.
fn pick(host: &HostGaussians, index: &[u32]) -> HostGaussians {
    let head = |head: &HostHead| HostHead {
        rotations: index.iter().map(|i| head.rotations[*i as usize]).collect(),
        log_scales: index.iter().map(|i| head.log_scales[*i as usize]).collect(),
        opacity_logits: index.iter().map(|i| head.opacity_logits[*i as usize]).collect(),
        features: index
            .iter()
            .flat_map(|i| &head.features[*i as usize * head.channels..][..head.channels])
            .copied()
            .collect(),
        channels: head.channels,
    };
    HostGaussians {
        means: index.iter().map(|i| host.means[*i as usize]).collect(),
        color: head(&host.color),
        language: head(&host.language),
    }
}
