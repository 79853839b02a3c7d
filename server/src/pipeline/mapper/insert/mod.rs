//! New Gaussians, only where the map does not explain a keyframe.
//!
//! In: a keyframe and the map rendered from its pose. Out: Gaussians appended, one per square of the
//! picture, squares as large as the picture is flat. It must not move what is there.

mod birth;
mod cells;
mod tried;

use super::super::backdrop;
use super::super::working::Working;
use super::keyframe::Keyframe;
use super::{Mapper, MapperConfig};
use birth::newborns;
use cells::{Cell, Grain, cells};
use lexsplat_gpu::{ColorImage, GpuError};
use std::borrow::Cow;
use tried::Tried;

impl Mapper {
    /// Appends what the keyframe shows and the map does not have.
    pub(super) fn insert(&mut self, keyframe: &Keyframe) -> Result<(), GpuError> {
        let rendered =
            self.trainer.renderer().render_color(&self.gaussians, &keyframe.working.camera)?;
        let room = self.config.max_gaussians.saturating_sub(self.gaussians.len());
        let depths = keyframe.working.depth_metres.iter().copied();
        self.farthest_metres = depths.fold(self.farthest_metres, f32::max);
        let mut seen = keyframe.in_map_colors();
        let backdrop = self.backdrop_metres();
        if let Some(metres) = backdrop {
            seen = Cow::Owned(backdrop::filled(&seen, metres));
        }
        let beyond = backdrop.unwrap_or(f32::INFINITY);
        let tried = Tried {
            pictures: self.keyframes.iter().map(|keyframe| &keyframe.working).collect(),
            enough: self.config.insert_keyframes,
        };
        let born = unexplained(&seen, (&rendered, &tried), beyond, &self.config);
        let kept = born.len().min(room);
        if kept < born.len() {
            tracing::warn!(
                map = self.map.name(),
                left_out = born.len() - kept,
                "mapper.max_gaussians is reached"
            );
        }
        let newborns = newborns(&seen, &born[..kept], beyond, self.online.code_size());
        self.gaussians.append(&newborns)?;
        self.changed = true;
        Ok(())
    }

    /// How far away a picture's pixels are taken to be that have no depth.
    fn backdrop_metres(&self) -> Option<f32> {
        let metres = self.config.insert_backdrop * self.farthest_metres;
        (metres > 0.0).then_some(metres)
    }
}

/// The squares that get a Gaussian: where the map does not explain the frame, as fine as its detail.
/// Depths of `beyond` and more are a backdrop's.
fn unexplained(
    working: &Working,
    map: (&ColorImage, &Tried<'_>),
    beyond: f32,
    config: &MapperConfig,
) -> Vec<Cell> {
    let needs = |pixel| needs_gaussian(working, map, beyond, config, pixel);
    let wanted: Vec<bool> = (0..working.camera.pixels()).map(needs).collect();
    let grain = Grain {
        max_side: config.insert_max_pixels as usize,
        min_side: config.insert_min_pixels as usize,
        detail: config.insert_detail,
        relief: config.insert_depth_error,
    };
    cells(working, &wanted, grain)
}

/// Whether the map leaves this pixel open; or lies behind it or shows another color, and has not been told
/// so often. Before a backdrop only what is open counts.
fn needs_gaussian(
    working: &Working,
    (rendered, tried): (&ColorImage, &Tried<'_>),
    beyond: f32,
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
    if !is_opaque || measured >= beyond {
        return !is_opaque;
    }
    let depth = rendered.depth[pixel] / opacity;
    let is_behind = depth - measured > config.insert_depth_error * measured;
    let on_surface = (depth - measured).abs() <= config.insert_depth_error * measured;
    let error = (0..3)
        .map(|channel| {
            let at = pixel * 3 + channel;
            (rendered.rgb[at] - f32::from(working.rgb[at]) / 255.0).abs()
        })
        .sum::<f32>()
        / 3.0;
    (is_behind || (on_surface && error > config.insert_color_error)) && !tried.often(working, pixel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lexsplat_gpu::Camera;
    use nalgebra::Isometry3;

    const SIZE: usize = 8;
    /// No keyframe was there before.
    const UNTRIED: Tried<'static> = Tried { pictures: Vec::new(), enough: 8 };

    /// A grey wall, 2 m away.
    pub(super) fn working(size: usize) -> Working {
        let centre = (size as f32 - 1.0) / 2.0;
        let camera = Camera {
            width: size as u32,
            height: size as u32,
            fx: 6.0,
            fy: 6.0,
            cx: centre,
            cy: centre,
            camera_from_world: Isometry3::identity(),
        };
        Working {
            camera,
            rgb: vec![128; size * size * 3].into(),
            depth_metres: vec![2.0; size * size].into(),
        }
    }

    /// What a map that explains [`working`] perfectly would render.
    fn explained() -> ColorImage {
        ColorImage {
            width: SIZE as u32,
            height: SIZE as u32,
            rgb: vec![128.0 / 255.0; SIZE * SIZE * 3],
            depth: vec![2.0; SIZE * SIZE],
            opacity: vec![1.0; SIZE * SIZE],
        }
    }

    fn count(working: &Working, rendered: &ColorImage) -> usize {
        unexplained(working, (rendered, &UNTRIED), f32::INFINITY, &MapperConfig::default()).len()
    }

    #[test]
    fn nothing_is_inserted_where_the_map_explains_the_frame() {
        assert_eq!(count(&working(SIZE), &explained()), 0);
    }

    #[test]
    fn squares_are_filled_where_it_does_not() {
        let wall = working(SIZE);
        let squares = (SIZE / MapperConfig::default().insert_max_pixels as usize).pow(2);
        let open = ColorImage { opacity: vec![0.0; SIZE * SIZE], ..explained() };
        assert_eq!(count(&wall, &open), squares, "nothing there");
        let behind = ColorImage { depth: vec![4.0; SIZE * SIZE], ..explained() };
        assert_eq!(count(&wall, &behind), squares, "the map lies behind");
        let before = ColorImage { depth: vec![1.0; SIZE * SIZE], ..explained() };
        assert_eq!(count(&wall, &before), 0, "a floater in front hides, it does not miss");
        let other = ColorImage { rgb: vec![0.0; SIZE * SIZE * 3], ..explained() };
        assert_eq!(count(&wall, &other), squares, "another color");
        let often = Tried { pictures: vec![&wall; 8], enough: 8 };
        let told = |map| {
            let config = MapperConfig::default();
            unexplained(&wall, (map, &often), f32::INFINITY, &config).len()
        };
        assert_eq!((told(&other), told(&behind)), (0, 0), "it was told so eight times");
        assert_eq!(told(&open), squares, "what is open is always filled");
        let broken = ColorImage { opacity: vec![f32::NAN; SIZE * SIZE], ..explained() };
        assert_eq!(count(&wall, &broken), squares, "a broken picture explains nothing");
    }

    #[test]
    fn what_is_not_measured_gets_a_backdrop_or_nothing() {
        let blind = Working { depth_metres: vec![0.0; SIZE * SIZE].into(), ..working(SIZE) };
        let open = ColorImage { opacity: vec![0.0; SIZE * SIZE], ..explained() };
        assert_eq!(count(&blind, &open), 0);
        let config = MapperConfig::default();
        let before = backdrop::filled(&blind, 5.0);
        assert!(before.depth_metres.iter().all(|depth| *depth == 5.0));
        let cells = unexplained(&before, (&open, &UNTRIED), 5.0, &config);
        assert_eq!(cells.len(), count(&working(SIZE), &open), "as a wall there");
        // Whatever the map shows there hides it, in any color and at any depth.
        let other = ColorImage { rgb: vec![0.0; SIZE * SIZE * 3], ..explained() };
        assert!(unexplained(&before, (&other, &UNTRIED), 5.0, &config).is_empty());
        // Negative control: what was measured at 5 m would be missing.
        let farther = ColorImage { depth: vec![9.0; SIZE * SIZE], ..explained() };
        assert!(!unexplained(&before, (&farther, &UNTRIED), f32::INFINITY, &config).is_empty());
        assert!(unexplained(&before, (&farther, &UNTRIED), 5.0, &config).is_empty());

        let kept = |beyond| backdrop::without(&newborns(&before, &cells, beyond, 15)).len();
        assert_eq!((kept(5.0), kept(5.1)), (0, cells.len()));
        assert_eq!(
            backdrop::filled(&working(SIZE), 5.0).depth_metres[0],
            2.0,
            "a measurement stays"
        );
    }
}
