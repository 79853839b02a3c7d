//! Inserts new Gaussians where the map does not explain a keyframe.
//!
//! In: a keyframe and the map rendered from its pose. Out: Gaussians appended to the map, one for each cell
//! of a quadtree over the image. Cells are large where the image is flat. Existing Gaussians are not moved.
//!
//! Where keyframes of a real camera disagree about the same surfaces (`disagreement.rs`), detail of one of
//! them is not repeated by the others. Such a keyframe adds larger Gaussians, at fewer visits.

mod disagreement;
mod disks;
mod edge;
mod gain;
mod history;
mod quadtree;

use super::super::backdrop::{self, DETAIL_LOGIT};
use super::super::downsampled_frame::DownsampledFrame;
use super::super::keyframes::Keyframe;
use super::super::live_map::LiveMap;
use super::config::MapperConfig;
use disagreement::disagreement;
use disks::new_gaussians;
use gain::on_surface;
use history::InsertionHistory;
use lexsplat_gpu::{ColorImage, GpuError, HostGaussians, Trainer};
use quadtree::{Cell, Subdivision, quadtree};
use std::borrow::Cow;

/// In a keyframe that disagrees with others, the smallest cell is larger by this factor;
const ROUGH_SIDE: usize = 2;
/// if the disagreement is more than this many times the limit,
const VERY_ROUGH: f32 = 1.5;
/// it is larger by this factor;
const VERY_ROUGH_SIDE: usize = 4;
/// a cell may have a color range of this many times the disagreement,
const ROUGH_DETAIL: f32 = 16.0;
/// a place gets corrections from this share of the visits,
const ROUGH_VISITS: usize = 2;
/// and what the map shows may be off by this many pixels.
const ROUGH_SHIFT: usize = 1;

/// Appends Gaussians for what the keyframe shows and the map does not have. The keyframe is not in the store
/// yet.
///
/// # Errors
/// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
pub(in super::super) fn insert(
    live: &mut LiveMap,
    trainer: &mut Trainer,
    keyframe: &Keyframe,
    config: &MapperConfig,
) -> Result<(), GpuError> {
    let depths = keyframe.training.depth_metres.iter().copied();
    live.farthest_metres = depths.fold(live.farthest_metres, f32::max);
    let earlier: Vec<&DownsampledFrame> = live.keyframes.iter().map(|kf| &kf.training).collect();
    let picture = Picture {
        image: keyframe.in_map_colors(Cow::Borrowed(&keyframe.training)),
        disagreement: disagreement(&keyframe.training, earlier.iter().copied()),
        visitors: earlier,
    };
    tracing::debug!(
        sequence = keyframe.frame.sequence,
        disagreement = picture.disagreement,
        "inserting"
    );
    let new = missing(live, trainer, picture, config)?;
    append(live, &new)
}

/// Appends Gaussians for the detail that a window of a keyframe shows and the map does not have. Only
/// keyframes whose detail was inserted count as visits. The new Gaussians have color alone: language is as
/// coarse as before, and stays where it is.
///
/// # Errors
/// As [`insert`].
pub(super) fn insert_detail(
    live: &mut LiveMap,
    trainer: &mut Trainer,
    at: usize,
    window: usize,
    config: &MapperConfig,
) -> Result<(), GpuError> {
    let keyframe = live.keyframes.at(at);
    let earlier = live.keyframes.iter().take(at).map(|keyframe| &keyframe.training);
    let is_visitor = |other: &&Keyframe| {
        let sequence = other.frame.sequence;
        sequence != keyframe.frame.sequence && live.refinement.has_detail_of(sequence)
    };
    let picture = Picture {
        image: keyframe.in_map_colors(keyframe.window(window)),
        disagreement: disagreement(&keyframe.training, earlier),
        visitors: live.keyframes.iter().filter(is_visitor).map(|kf| &kf.training).collect(),
    };
    let mut new = missing(live, trainer, picture, config)?;
    new.language.opacity_logits.fill(DETAIL_LOGIT);
    append(live, &new)
}

fn append(live: &mut LiveMap, new: &HostGaussians) -> Result<(), GpuError> {
    let scales = new.color.log_scales.as_flattened().iter().map(|scale| scale.exp());
    live.largest_scale_metres = scales.fold(live.largest_scale_metres, f32::max);
    live.gaussians.append(new)
}

/// A picture that the map is to explain.
struct Picture<'a> {
    /// In the map's exposure.
    image: Cow<'a, DownsampledFrame>,
    /// How much its keyframe disagrees with earlier ones.
    disagreement: f32,
    /// Keyframes that got Gaussians at this size before.
    visitors: Vec<&'a DownsampledFrame>,
}

/// Gaussians for what a picture shows and the map does not have.
fn missing(
    live: &LiveMap,
    trainer: &mut Trainer,
    picture: Picture<'_>,
    config: &MapperConfig,
) -> Result<HostGaussians, GpuError> {
    let Picture { mut image, disagreement, visitors } = picture;
    let rendered = trainer.renderer().render_color(&live.gaussians, &image.camera)?;
    let backdrop_metres = config.insert_backdrop * live.farthest_metres;
    let has_backdrop = backdrop_metres > 0.0;
    if has_backdrop {
        image = Cow::Owned(backdrop::filled(&image, backdrop_metres));
    }
    let backdrop_metres = if has_backdrop { backdrop_metres } else { f32::INFINITY };
    let gains = gain::gains(&image, &rendered, backdrop_metres, config.insert_depth_error);
    image = gain::apply(image, gains);
    let is_rough = disagreement > config.insert_disagreement;
    let visits = if is_rough { ROUGH_VISITS } else { 1 };
    let history =
        InsertionHistory { keyframes: visitors, limit: config.insert_keyframes.div_ceil(visits) };
    let rough = is_rough.then_some(disagreement);
    let view =
        View { image: &image, rendered: &rendered, history: &history, backdrop_metres, rough };
    let mut cells = view.unexplained(config);
    let room = config.max_gaussians.saturating_sub(live.gaussians.len());
    if cells.len() > room {
        let left_out = cells.len() - room;
        tracing::warn!(
            left_out,
            "mapper.max_gaussians is reached: some Gaussians are not inserted"
        );
        cells.truncate(room);
    }
    Ok(new_gaussians(&image, &cells, view.backdrop_metres, live.online.code_size()))
}

/// A keyframe beside what the map shows from its pose.
struct View<'a> {
    /// In the map's colors; depth filled with the backdrop's where nothing was measured.
    image: &'a DownsampledFrame,
    rendered: &'a ColorImage,
    history: &'a InsertionHistory<'a>,
    /// Depths from here on belong to the backdrop; infinite without one.
    backdrop_metres: f32,
    /// How much the keyframe disagrees with others, if that is too much to repeat its detail.
    rough: Option<f32>,
}

impl View<'_> {
    /// The cells that get a Gaussian: where the map does not explain the image, as fine as its detail.
    fn unexplained(&self, config: &MapperConfig) -> Vec<Cell> {
        let needs = |pixel| self.needs_gaussian(config, pixel);
        let wanted: Vec<bool> = (0..self.image.camera.pixels()).map(needs).collect();
        let (max_side, min_side) = (config.insert_max_pixels, config.insert_min_pixels);
        let (max_side, mut min_side) = (max_side as usize, min_side as usize);
        let mut max_color_range = config.insert_detail;
        if let Some(disagreement) = self.rough {
            let is_very_rough = disagreement > VERY_ROUGH * config.insert_disagreement;
            min_side *= if is_very_rough { VERY_ROUGH_SIDE } else { ROUGH_SIDE };
            min_side = min_side.min(max_side);
            max_color_range = max_color_range.max(ROUGH_DETAIL * disagreement);
        }
        let subdivision = Subdivision {
            max_side,
            min_side,
            max_color_range,
            max_depth_range: config.insert_depth_error,
        };
        quadtree(self.image, &wanted, subdivision)
    }

    /// Whether the map is transparent at this pixel, or lies behind the measured surface or has another
    /// color and did not get Gaussians there too often already. A backdrop pixel counts only if the map is
    /// transparent there.
    fn needs_gaussian(&self, config: &MapperConfig, pixel: usize) -> bool {
        let measured = self.image.depth_metres[pixel];
        if measured <= 0.0 {
            return false;
        }
        let opacity = self.rendered.opacity[pixel];
        // Phrased so that a NaN counts as transparent.
        let is_opaque = opacity >= config.insert_opacity;
        if !is_opaque || measured >= self.backdrop_metres {
            return !is_opaque;
        }
        let is_unexplained =
            if on_surface(self.rendered, pixel, measured, config.insert_depth_error) {
                self.nearby(pixel).all(|shown| {
                    color_error(self.image, self.rendered, pixel, shown) > config.insert_color_error
                })
            } else {
                // A depth that is not finite is behind nothing.
                let depths = self.nearby(pixel).map(|near| self.image.depth_metres[near]);
                let surface =
                    depths.filter(|depth| *depth < self.backdrop_metres).fold(0.0, f32::max);
                self.rendered.depth[pixel] / opacity - surface > config.insert_depth_error * surface
            };
        is_unexplained && !self.history.is_exhausted(self.image, pixel)
    }

    /// The pixel; in a rough keyframe also those around it, which the map may show in its place.
    fn nearby(&self, pixel: usize) -> impl Iterator<Item = usize> + use<> {
        let shift = if self.rough.is_some() { ROUGH_SHIFT } else { 0 };
        let camera = &self.image.camera;
        let (width, height) = (camera.width as usize, camera.height as usize);
        let around =
            move |at: usize, size: usize| at.saturating_sub(shift)..size.min(at + shift + 1);
        let rows = around(pixel / width, height);
        let columns = around(pixel % width, width);
        rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }
}

/// Mean absolute difference of the channels between a pixel that was seen and one that the map shows, 0 to 1.
fn color_error(image: &DownsampledFrame, rendered: &ColorImage, seen: usize, shown: usize) -> f32 {
    let shown = &rendered.rgb[shown * 3..shown * 3 + 3];
    let errors = shown.iter().zip(image.color(seen)).map(|(shown, seen)| (shown - seen).abs());
    errors.sum::<f32>() / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use lexsplat_gpu::Camera;
    use nalgebra::Isometry3;

    const SIZE: usize = 8;
    /// No keyframe was inserted before.
    const NO_HISTORY: InsertionHistory<'static> =
        InsertionHistory { keyframes: Vec::new(), limit: 8 };

    /// A grey wall, 2 m away.
    pub(super) fn wall(size: usize) -> DownsampledFrame {
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
        DownsampledFrame {
            camera,
            rgb: vec![128; size * size * 3].into(),
            depth_metres: vec![2.0; size * size].into(),
        }
    }

    /// What a map that explains [`wall`] perfectly renders.
    pub(super) fn explained() -> ColorImage {
        ColorImage {
            width: SIZE as u32,
            height: SIZE as u32,
            rgb: vec![128.0 / 255.0; SIZE * SIZE * 3],
            depth: vec![2.0; SIZE * SIZE],
            opacity: vec![1.0; SIZE * SIZE],
        }
    }

    fn cells(
        image: &DownsampledFrame,
        rendered: &ColorImage,
        history: &InsertionHistory<'_>,
        backdrop_metres: f32,
    ) -> Vec<Cell> {
        let view = View { image, rendered, history, backdrop_metres, rough: None };
        view.unexplained(&MapperConfig::default())
    }

    fn count(image: &DownsampledFrame, rendered: &ColorImage) -> usize {
        cells(image, rendered, &NO_HISTORY, f32::INFINITY).len()
    }

    #[test]
    fn nothing_is_inserted_where_the_map_explains_the_frame() {
        assert_eq!(count(&wall(SIZE), &explained()), 0);
    }

    #[test]
    fn squares_are_filled_where_it_does_not() {
        let wall = wall(SIZE);
        let squares = (SIZE / MapperConfig::default().insert_max_pixels as usize).pow(2);
        let open = ColorImage { opacity: vec![0.0; SIZE * SIZE], ..explained() };
        assert_eq!(count(&wall, &open), squares, "nothing there");
        let behind = ColorImage { depth: vec![4.0; SIZE * SIZE], ..explained() };
        assert_eq!(count(&wall, &behind), squares, "the map lies behind");
        let before = ColorImage { depth: vec![1.0; SIZE * SIZE], ..explained() };
        assert_eq!(count(&wall, &before), 0, "a floater in front hides, it does not miss");
        let other = ColorImage { rgb: vec![0.0; SIZE * SIZE * 3], ..explained() };
        assert_eq!(count(&wall, &other), squares, "another color");
        let history = InsertionHistory { keyframes: vec![&wall; 8], limit: 8 };
        let later = |map| cells(&wall, map, &history, f32::INFINITY).len();
        assert_eq!((later(&other), later(&behind)), (0, 0), "eight keyframes showed it already");
        assert_eq!(later(&open), squares, "a transparent place is always filled");
        let broken = ColorImage { opacity: vec![f32::NAN; SIZE * SIZE], ..explained() };
        assert_eq!(count(&wall, &broken), squares, "a broken picture explains nothing");
    }

    #[test]
    fn a_rough_keyframe_adds_larger_gaussians_and_forgives_a_shift() {
        let config = MapperConfig::default();
        let (mut striped, mut shifted) = (wall(SIZE), explained());
        let is_bright = |at: usize| at / 3 % SIZE == 4;
        striped.rgb =
            (0..SIZE * SIZE * 3).map(|at| if is_bright(at) { 255 } else { 128 }).collect();
        let found = |rendered: &ColorImage, rough| {
            let (image, backdrop_metres) = (&striped, f32::INFINITY);
            let view = View { image, rendered, history: &NO_HISTORY, backdrop_metres, rough };
            view.unexplained(&config)
        };
        let open = ColorImage { opacity: vec![0.0; SIZE * SIZE], ..explained() };
        let smallest = |cells: &[Cell]| cells.iter().map(|cell| cell.side).min();
        assert_eq!(smallest(&found(&open, None)), Some(2), "as fine as the stripe");
        assert_eq!(smallest(&found(&open, Some(0.012))), Some(4));
        assert_eq!(
            smallest(&found(&open, Some(0.035))),
            Some(8),
            "no finer than what is agreed on"
        );
        shifted.rgb = (0..SIZE * SIZE * 3)
            .map(|at| if is_bright(at + 3) { 1.0 } else { 128.0 / 255.0 })
            .collect();
        assert!(!found(&shifted, None).is_empty(), "negative control");
        assert!(found(&shifted, Some(0.01)).is_empty(), "off by a pixel");
    }

    #[test]
    fn what_is_not_measured_gets_a_backdrop_or_nothing() {
        let blind = DownsampledFrame { depth_metres: vec![0.0; SIZE * SIZE].into(), ..wall(SIZE) };
        let open = ColorImage { opacity: vec![0.0; SIZE * SIZE], ..explained() };
        assert_eq!(count(&blind, &open), 0);
        let filled = backdrop::filled(&blind, 5.0);
        assert!(filled.depth_metres.iter().all(|depth| *depth == 5.0));
        let behind = cells(&filled, &open, &NO_HISTORY, 5.0);
        assert_eq!(behind.len(), count(&wall(SIZE), &open), "as a wall there");
        // Whatever the map shows there hides the backdrop, in any color and at any depth.
        let other = ColorImage { rgb: vec![0.0; SIZE * SIZE * 3], ..explained() };
        assert!(cells(&filled, &other, &NO_HISTORY, 5.0).is_empty());
        // Negative control: a surface measured at 5 m would be missing.
        let farther = ColorImage { depth: vec![9.0; SIZE * SIZE], ..explained() };
        assert!(!cells(&filled, &farther, &NO_HISTORY, f32::INFINITY).is_empty());
        assert!(cells(&filled, &farther, &NO_HISTORY, 5.0).is_empty());

        let kept = |beyond| backdrop::without(&new_gaussians(&filled, &behind, beyond, 15)).len();
        assert_eq!((kept(5.0), kept(5.1)), (0, behind.len()));
        assert_eq!(backdrop::filled(&wall(SIZE), 5.0).depth_metres[0], 2.0, "a measurement stays");
    }
}
