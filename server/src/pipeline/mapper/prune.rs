//! Removal of Gaussians that show nothing, or too much.

use super::Mapper;
use lexsplat_gpu::{GpuError, HostGaussians};

impl Mapper {
    /// Removes Gaussians that are transparent in **both** heads (paper §4.3), too large, or not finite.
    pub(super) fn prune(&mut self) -> Result<(), GpuError> {
        self.renderer.settle(&mut self.gaussians)?;
        let host = self.gaussians.to_host()?;
        let keep = worth_keeping(&host, self.config.prune_opacity, self.config.prune_scale_metres);
        let removed = keep.iter().filter(|keep| !**keep).count();
        if removed > 0 {
            self.gaussians.retain(&keep)?;
            tracing::debug!(map = self.map.name(), removed, "pruned");
        }
        Ok(())
    }
}

fn worth_keeping(host: &HostGaussians, opacity: f32, scale_metres: f32) -> Vec<bool> {
    let logit = (opacity / (1.0 - opacity)).ln();
    let log_scale = scale_metres.ln();
    (0..host.means.len())
        .map(|at| {
            let shows = host.colour.opacity_logits[at] >= logit
                || host.language.opacity_logits[at] >= logit;
            let fits = host.colour.log_scales[at].iter().all(|scale| *scale <= log_scale);
            shows && fits && host.means[at].iter().all(|metres| metres.is_finite())
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lexsplat_gpu::HostHead;

    fn one(colour: f32, language: f32, log_scale: f32, x: f32) -> HostGaussians {
        let head = |opacity_logit, channels| HostHead {
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[log_scale; 3]],
            opacity_logits: vec![opacity_logit],
            features: vec![0.0; channels],
            channels,
        };
        HostGaussians {
            means: vec![[x, 0.0, 1.0]],
            colour: head(colour, 3),
            language: head(language, 15),
        }
    }

    #[test]
    fn goes_only_when_both_heads_are_transparent() {
        let keep =
            |colour, language| worth_keeping(&one(colour, language, -4.0, 0.0), 0.05, 0.6)[0];
        assert!(keep(2.0, -9.0), "the colour head still shows");
        assert!(keep(-9.0, 2.0), "the language head still shows");
        assert!(!keep(-9.0, -9.0), "neither shows");
    }

    #[test]
    fn goes_when_huge_or_nowhere() {
        assert!(!worth_keeping(&one(2.0, 2.0, 0.0, 0.0), 0.05, 0.6)[0], "one metre long");
        assert!(!worth_keeping(&one(2.0, 2.0, -4.0, f32::NAN), 0.05, 0.6)[0], "nowhere");
        assert!(worth_keeping(&one(2.0, 2.0, -4.0, 1.0), 0.05, 0.6)[0], "and this one stays");
    }
}
