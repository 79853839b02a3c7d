//! One keyframe: a frame that the map is optimised against and that later frames are aligned with.

use super::super::downsampled_frame::DownsampledFrame;
use super::super::exposure;
use super::super::frame::{Frame, Intrinsics, TrackedFrame, TrackedPose, rasteriser_camera};
use super::super::pose_adam::PoseAdam;
use super::super::up::Facet;
use super::language::KeyframeLanguage;
use super::thumbnail::Thumbnail;
use super::visits::Visits;
use super::windows::{FullDepth, Grid, cut};
use lexsplat_gpu::{Camera, ColorTarget, GpuError};
use lexsplat_pictures::Features;
use nalgebra::{Isometry3, Point3};
use std::borrow::Cow;
use std::sync::Arc;

/// Points of a keyframe that measure how much of it a camera sees.
const OVERLAP_POINTS: usize = 64;

/// All that is known of a keyframe.
pub(in super::super) struct Keyframe {
    /// Sequence number, time, pose and exposure as they are now.
    pub frame: TrackedFrame,
    pub intrinsics: Intrinsics,
    /// `[height * width * 3]`, row-major RGB as received.
    pub rgb: Arc<[u8]>,
    /// Color and depth at the training resolution (`mapper.train_width`). Thin gaps in depth are closed,
    /// here and in `tracking`.
    pub training: DownsampledFrame,
    /// The training image, for steps on it.
    pub target: ColorTarget,
    /// Depth as received, if the training image is smaller and the map is refined.
    pub(super) full_depth: Option<FullDepth>,
    /// Color and depth at the tracker's resolution (`tracker.width`). Its pose is not kept up to date.
    pub tracking: DownsampledFrame,
    /// Exposure (a, b): the map's intensity is exp(a) times the keyframe's plus b. The inverse of
    /// `frame.exposure`, in double precision.
    pub map_exposure: [f64; 2],
    /// Corners for relocalisation.
    pub features: Features,
    /// Grey thumbnail for relocalisation.
    pub thumbnail: Thumbnail,
    /// Pieces of its surfaces, which tell the direction up.
    pub facets: Vec<Facet>,
    /// Whether the tracker estimated the pose, so that the map may refine it.
    pub is_estimated: bool,
    /// Whether frames are aligned with it: its place relative to the newest keyframe is well known.
    pub is_connected: bool,
    /// Adam's moments of the refined pose and exposure.
    pub pose_adam: PoseAdam,
    pub visits: Visits,
    /// Its language, once the networks are done.
    pub language: Option<KeyframeLanguage>,
    /// Some measured points in the keyframe's own camera.
    pub(super) overlap_points: Vec<Point3<f64>>,
}

/// Resolutions at which a keyframe is kept, in columns at most.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct KeyframeWidths {
    pub training: u32,
    pub tracking: u32,
    /// Whether it is kept at full size as well.
    pub full: bool,
}

impl Keyframe {
    /// Makes a keyframe of a tracked frame.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`] if the frame has more or fewer pixels than its size says.
    pub fn new(
        frame: &Frame,
        tracked: &TrackedPose,
        widths: KeyframeWidths,
    ) -> Result<Self, GpuError> {
        let pose = &tracked.world_from_camera;
        let resized = |width| DownsampledFrame::new(frame, pose, width).without_gaps();
        let training = resized(widths.training);
        let target = color_target(&training)?;
        let width = training.camera.width;
        let is_reduced = width < frame.intrinsics.width;
        let full_depth = (widths.full && is_reduced).then(|| FullDepth::new(frame));
        let is_same_size = DownsampledFrame::columns(frame, widths.tracking) == width;
        let tracking = if is_same_size { training.clone() } else { resized(widths.tracking) };
        Ok(Self {
            frame: TrackedFrame::new(frame, tracked),
            intrinsics: frame.intrinsics,
            rgb: frame.rgb.clone(),
            target,
            full_depth,
            map_exposure: tracked.exposure,
            features: Features::detect(&tracking.picture()),
            thumbnail: Thumbnail::new(&tracking),
            facets: Facet::sampled(&tracking),
            is_estimated: tracked.is_estimated,
            is_connected: true,
            pose_adam: PoseAdam::default(),
            visits: Visits::default(),
            language: None,
            overlap_points: overlap_points(&tracking),
            training,
            tracking,
        })
    }

    /// Memory of its images and codes. Images that share their pixels count once. What steps need on the
    /// device does not count: it is there for the keyframes that were used last.
    pub fn bytes(&self) -> u64 {
        let mut images: Vec<(usize, usize)> = Vec::new();
        let rgb = [&self.rgb, &self.training.rgb, &self.tracking.rgb];
        images.extend(rgb.map(|rgb| (rgb.as_ptr() as usize, rgb.len())));
        let depth = [&self.training.depth_metres, &self.tracking.depth_metres];
        images.extend(depth.map(|depth| (depth.as_ptr() as usize, size_of_val(&depth[..]))));
        images.sort_unstable();
        images.dedup();
        let host: usize = images.iter().map(|(_, bytes)| bytes).sum();
        let language = self.language.as_ref().map_or(0, KeyframeLanguage::bytes);
        let full_depth = self.full_depth.as_ref().map_or(0, FullDepth::bytes);
        (host + self.features.bytes()) as u64 + language + full_depth
    }

    /// Number of windows that the full picture is cut into; 1 if the training image is all there is.
    pub fn windows(&self) -> usize {
        match &self.full_depth {
            Some(_) => Grid::new(&self.intrinsics, &self.training.camera).len(),
            None => 1,
        }
    }

    /// A window of the full picture; the training image if that is all there is.
    pub fn window(&self, index: usize) -> Cow<'_, DownsampledFrame> {
        let Some(depth) = &self.full_depth else { return Cow::Borrowed(&self.training) };
        let full = rasteriser_camera(&self.intrinsics, &self.frame.world_from_camera);
        let grid = Grid::new(&self.intrinsics, &self.training.camera);
        let window = grid.window(index, &full);
        Cow::Owned(cut(&self.rgb, depth, full.width as usize, window))
    }

    /// Sets the pose everywhere it is kept.
    pub fn set_pose(&mut self, world_from_camera: &Isometry3<f64>) {
        self.frame.world_from_camera = *world_from_camera;
        self.frame.world_from_camera.rotation.renormalize();
        self.training.set_pose(world_from_camera);
        if let Some(language) = &mut self.language {
            language.camera.camera_from_world = self.training.camera.camera_from_world;
        }
    }

    /// Sets the exposure (a, b) with which the keyframe shows the map, and its inverse.
    pub fn set_exposure(&mut self, exposure: [f32; 2]) {
        self.frame.exposure = exposure;
        self.map_exposure = exposure::inverse(exposure.map(f64::from));
    }

    /// One of its images with the exposure removed.
    pub fn in_map_colors<'i>(&self, image: Cow<'i, DownsampledFrame>) -> Cow<'i, DownsampledFrame> {
        let [a, b] = self.frame.exposure;
        if [a, b] == [0.0; 2] {
            return image;
        }
        let map_color = |value: u8| (f32::from(value) / 255.0 - b) * (-a).exp() * 255.0;
        let rgb = image.rgb.iter().map(|value| map_color(*value).round() as u8).collect();
        Cow::Owned(DownsampledFrame { rgb, ..image.into_owned() })
    }

    /// The share of the keyframe's surface that lies in the image of a camera at `world_from_camera`, 0
    /// to 1. Occlusion is not considered.
    pub fn overlap(&self, camera: &Camera, world_from_camera: &Isometry3<f64>) -> f64 {
        let camera_from_keyframe = world_from_camera.inverse() * self.frame.world_from_camera;
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        let is_inside = |point: &&Point3<f64>| {
            let p = camera_from_keyframe * **point;
            let u = f64::from(camera.fx) * p.x / p.z + f64::from(camera.cx);
            let v = f64::from(camera.fy) * p.y / p.z + f64::from(camera.cy);
            p.z > 0.0 && u >= 0.0 && v >= 0.0 && u < width && v < height
        };
        let inside = self.overlap_points.iter().filter(is_inside).count();
        inside as f64 / self.overlap_points.len().max(1) as f64
    }
}

/// A target that is on the device for the steps on it, and shares the picture's pixels.
pub(super) fn color_target(image: &DownsampledFrame) -> Result<ColorTarget, GpuError> {
    let Camera { width, height, .. } = image.camera;
    ColorTarget::of_picture(width, height, image.rgb.clone(), image.depth_metres.clone())
}

/// About [`OVERLAP_POINTS`] measured points in the camera's own coordinates.
fn overlap_points(image: &DownsampledFrame) -> Vec<Point3<f64>> {
    let camera = Camera { camera_from_world: Isometry3::identity(), ..image.camera.clone() };
    let depths = &image.depth_metres;
    let stride = (depths.len() / OVERLAP_POINTS).max(1);
    // An offset that differs from stretch to stretch keeps the points from standing in one column.
    (0..depths.len() / stride)
        .map(|i| i * stride + i * 7 % stride)
        .filter(|at| depths[*at] > 0.0)
        .map(|at| {
            let (u, v) = (at % camera.width as usize, at / camera.width as usize);
            camera.unproject(u as f32, v as f32, depths[at]).cast()
        })
        .collect()
}
