//! Removal of Gaussians that show nothing, and their order in memory. All on the device:
//! the map does not come to the host for it.

use super::Mapper;
use lexsplat_gpu::GpuError;

/// The map is brought into spatial order again when it has grown by this factor.
const GROWTH_TO_REORDER: f64 = 1.3;

impl Mapper {
    /// Removes Gaussians that are transparent in **both** heads (paper §4.3), or not finite. A large
    /// one may be all that shows a far wall: it stays.
    pub(super) fn prune(&mut self) -> Result<(), GpuError> {
        self.trainer.settle(&mut self.gaussians)?;
        let removed = self.gaussians.prune(self.config.prune_opacity)?;
        if removed > 0 {
            tracing::debug!(map = self.map.name(), removed, "pruned");
        }
        if self.gaussians.len() as f64 > GROWTH_TO_REORDER * self.ordered_len as f64 {
            self.gaussians.reorder_morton()?;
            self.ordered_len = self.gaussians.len();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::MapperConfig;
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
