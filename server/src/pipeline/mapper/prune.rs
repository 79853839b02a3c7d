//! Removes transparent Gaussians and keeps the others in spatial order. Both happen on the device.

use super::super::live_map::LiveMap;
use super::config::MapperConfig;
use lexsplat_gpu::{GpuError, Trainer};

/// Gaussians are sorted again when their number has grown by this factor.
const GROWTH_TO_SORT: f64 = 1.3;

/// Removes Gaussians that are transparent in **both** heads (paper §4.3) or not finite. Large ones stay: one
/// of them may be all that shows a far wall.
///
/// # Errors
/// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
pub(super) fn prune(
    live: &mut LiveMap,
    trainer: &mut Trainer,
    config: &MapperConfig,
) -> Result<(), GpuError> {
    trainer.settle(&mut live.gaussians)?;
    let removed = live.gaussians.prune(config.prune_opacity)?;
    if removed > 0 {
        tracing::debug!(removed, "pruned");
    }
    if live.gaussians.len() as f64 > GROWTH_TO_SORT * live.sorted_len as f64 {
        live.gaussians.reorder_morton()?;
        live.sorted_len = live.gaussians.len();
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::config::MapperConfig;
    use lexsplat_gpu::{Gaussians, Gpu, HostGaussians, HostHead};

    /// Whether a Gaussian with these opacity logits, log scale and place stays.
    fn stays([color, language]: [f32; 2], log_scale: f32, x: f32) -> bool {
        let gpu = Gpu::new(None).expect("these tests need a vulkan adapter");
        let head = |opacity_logit, channels| HostHead {
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[log_scale; 3]],
            opacity_logits: vec![opacity_logit],
            features: vec![0.0; channels],
            channels,
        };
        let one = HostGaussians {
            means: vec![[x, 0.0, 1.0]],
            color: head(color, 3),
            language: head(language, 15),
        };
        let mut map = Gaussians::new(&gpu, 15);
        map.append(&one).expect("fits");
        map.prune(MapperConfig::default().prune_opacity).expect("prunes");
        !map.is_empty()
    }

    #[test]
    fn goes_only_when_both_heads_are_transparent() {
        assert!(stays([2.0, -9.0], -4.0, 0.0), "the color head still shows");
        assert!(stays([-9.0, 2.0], -4.0, 0.0), "the language head still shows");
        assert!(!stays([-9.0, -9.0], -4.0, 0.0), "neither shows");
    }

    #[test]
    fn goes_when_nowhere_and_not_when_large() {
        assert!(stays([2.0, 2.0], 1.0, 0.0), "three metres long");
        assert!(!stays([2.0, 2.0], -4.0, f32::NAN), "nowhere");
        assert!(stays([2.0, 2.0], -4.0, 1.0), "and this one stays");
    }
}
