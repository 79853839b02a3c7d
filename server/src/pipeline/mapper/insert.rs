//! New Gaussians, only where the map does not explain a keyframe.
//!
//! In: a keyframe and the map rendered from its pose. Out: Gaussians appended, one at most per cell
//! of the image. Their language heads start as their colour heads, with codes of zeros ("no
//! language yet").

use super::super::working::Working;
use super::keyframe::Keyframe;
use super::{Mapper, MapperConfig};
use lexsplat_gpu::{ColourImage, GpuError, HostGaussians, HostHead};

/// Opacity that a Gaussian is born with, as a logit: 0.8.
const BIRTH_OPACITY_LOGIT: f32 = 1.386_294_4;
/// Standard deviation of a newborn, in units of the cells' spacing.
const BIRTH_SCALE: f32 = 0.6;

impl Mapper {
    /// Appends what the keyframe shows and the map does not have.
    pub(super) fn insert(&mut self, keyframe: &Keyframe) -> Result<(), GpuError> {
        let rendered = self.renderer.render_colour(&self.gaussians, &keyframe.working.camera)?;
        let room = self.config.max_gaussians.saturating_sub(self.gaussians.len());
        let seen = keyframe.in_map_colours();
        let born = unexplained(&seen, &rendered, &self.config);
        let kept = born.len().min(room);
        if kept < born.len() {
            tracing::warn!(
                map = self.map.name(),
                left_out = born.len() - kept,
                "mapper.max_gaussians is reached"
            );
        }
        let newborns = newborns(&seen, &born[..kept], &self.config, self.online.code_size());
        self.gaussians.append(&newborns)?;
        self.changed = true;
        Ok(())
    }
}

/// The pixels that get a Gaussian: in each cell the measured pixel that is explained worst, if it is
/// explained badly enough.
fn unexplained(working: &Working, rendered: &ColourImage, config: &MapperConfig) -> Vec<usize> {
    let (width, height) = (working.camera.width as usize, working.camera.height as usize);
    let spacing = config.insert_spacing_pixels.max(1) as usize;
    let mut chosen = Vec::new();
    for top in (0..height).step_by(spacing) {
        for left in (0..width).step_by(spacing) {
            let centre =
                (top + spacing / 2).min(height - 1) * width + (left + spacing / 2).min(width - 1);
            if needs_gaussian(working, rendered, config, centre) {
                chosen.push(centre);
            }
        }
    }
    chosen
}

/// Whether the map leaves this pixel open, lies behind it, or shows another colour.
fn needs_gaussian(
    working: &Working,
    rendered: &ColourImage,
    config: &MapperConfig,
    pixel: usize,
) -> bool {
    let measured = working.depth_metres[pixel];
    if measured <= 0.0 {
        return false;
    }
    let opacity = rendered.opacity[pixel];
    // A NaN in the picture is not opaque: it asks for a Gaussian.
    let is_opaque = opacity >= config.insert_opacity;
    if !is_opaque {
        return true;
    }
    let depth = rendered.depth[pixel] / opacity;
    if depth - measured > config.insert_depth_error * measured {
        return true;
    }
    let on_surface = (depth - measured).abs() <= config.insert_depth_error * measured;
    let error = (0..3)
        .map(|channel| {
            let at = pixel * 3 + channel;
            (rendered.rgb[at] - f32::from(working.rgb[at]) / 255.0).abs()
        })
        .sum::<f32>()
        / 3.0;
    on_surface && error > config.insert_color_error
}

fn newborns(
    working: &Working,
    pixels: &[usize],
    config: &MapperConfig,
    code_size: usize,
) -> HostGaussians {
    let width = working.camera.width as usize;
    let count = pixels.len();
    let spacing = config.insert_spacing_pixels.max(1) as f32;
    let head = |channels| HostHead {
        rotations: vec![[1.0, 0.0, 0.0, 0.0]; count],
        log_scales: Vec::with_capacity(count),
        opacity_logits: vec![BIRTH_OPACITY_LOGIT; count],
        features: Vec::new(),
        channels,
    };
    let mut colour = head(3);
    let mut means = Vec::with_capacity(count);
    for &pixel in pixels {
        let depth = working.depth_metres[pixel];
        let (u, v) = ((pixel % width) as f32, (pixel / width) as f32);
        means.push(working.camera.unproject(u, v, depth).into());
        let log_scale = (BIRTH_SCALE * spacing * depth / working.camera.fx).ln();
        colour.log_scales.push([log_scale; 3]);
        let rgb = &working.rgb[pixel * 3..pixel * 3 + 3];
        colour.features.extend(rgb.iter().map(|value| f32::from(*value) / 255.0));
    }
    let language = HostHead {
        log_scales: colour.log_scales.clone(),
        features: vec![0.0; count * code_size],
        ..head(code_size)
    };
    HostGaussians { means, colour, language }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lexsplat_gpu::Camera;
    use nalgebra::Isometry3;

    const SIZE: usize = 6;

    fn working() -> Working {
        let camera = Camera {
            width: SIZE as u32,
            height: SIZE as u32,
            fx: 6.0,
            fy: 6.0,
            cx: 2.5,
            cy: 2.5,
            camera_from_world: Isometry3::identity(),
        };
        Working {
            camera,
            rgb: vec![128; SIZE * SIZE * 3].into(),
            depth_metres: vec![2.0; SIZE * SIZE].into(),
        }
    }

    /// What a map that explains [`working`] perfectly would render.
    fn explained() -> ColourImage {
        ColourImage {
            width: SIZE as u32,
            height: SIZE as u32,
            rgb: vec![128.0 / 255.0; SIZE * SIZE * 3],
            depth: vec![2.0; SIZE * SIZE],
            opacity: vec![1.0; SIZE * SIZE],
        }
    }

    fn count(working: &Working, rendered: &ColourImage) -> usize {
        unexplained(working, rendered, &MapperConfig::default()).len()
    }

    #[test]
    fn nothing_is_inserted_where_the_map_explains_the_frame() {
        assert_eq!(count(&working(), &explained()), 0);
    }

    #[test]
    fn one_per_cell_where_it_does_not() {
        let cells = (SIZE / 3) * (SIZE / 3);
        let open = ColourImage { opacity: vec![0.0; SIZE * SIZE], ..explained() };
        assert_eq!(count(&working(), &open), cells, "nothing there");
        let behind = ColourImage { depth: vec![4.0; SIZE * SIZE], ..explained() };
        assert_eq!(count(&working(), &behind), cells, "the map lies behind");
        let before = ColourImage { depth: vec![1.0; SIZE * SIZE], ..explained() };
        assert_eq!(count(&working(), &before), 0, "a floater in front hides, it does not miss");
        let other = ColourImage { rgb: vec![0.0; SIZE * SIZE * 3], ..explained() };
        assert_eq!(count(&working(), &other), cells, "another colour");
        let broken = ColourImage { opacity: vec![f32::NAN; SIZE * SIZE], ..explained() };
        assert_eq!(count(&working(), &broken), cells, "a broken picture explains nothing");
    }

    #[test]
    fn nothing_is_inserted_without_a_measurement() {
        let blind = Working { depth_metres: vec![0.0; SIZE * SIZE].into(), ..working() };
        let open = ColourImage { opacity: vec![0.0; SIZE * SIZE], ..explained() };
        assert_eq!(count(&blind, &open), 0);
    }

    #[test]
    fn newborns_lie_on_the_surface_and_have_no_language() {
        let born = newborns(&working(), &[7], &MapperConfig::default(), 15);
        assert!((born.means[0][2] - 2.0).abs() < 1e-6, "at the measured depth");
        assert!((born.colour.features[0] - 128.0 / 255.0).abs() < 1e-6);
        assert_eq!(born.language.features, vec![0.0; 15]);
    }
}
