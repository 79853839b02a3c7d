//! Which frames become keyframes, and what is kept of them.

use super::super::frame::{Frame, Intrinsics};
use super::super::snapshot::TrackedFrame;
use super::super::tracker::{Moments, Tracked};
use super::super::working::Working;
use super::Mapper;
use half::f16;
use lexsplat_gpu::{Camera, ColorTarget, Gpu, GpuError, LanguageTarget};
use nalgebra::{Isometry3, Point3};
use std::borrow::Cow;
use std::sync::Arc;

/// Points of a frame that are looked for in keyframes.
const SAMPLES: f64 = 1000.0;

/// A frame that the map is optimised against.
pub(super) struct Keyframe {
    pub frame: TrackedFrame,
    pub intrinsics: Intrinsics,
    /// `[height * width * 3]`, as received.
    pub rgb: Arc<[u8]>,
    /// What it is optimised at: at most `train_width` columns.
    pub working: Working,
    /// The working image on the device.
    pub target: ColorTarget,
    /// Whether its pose is the tracker's own, so that it may be refined.
    pub is_estimated: bool,
    /// Memory of the tracker's own picture of it.
    pub tracker_bytes: u64,
    /// Of its pose's and exposure's refinement.
    pub moments: Moments,
    /// Optimiser steps on it so far.
    pub steps: usize,
    /// Its language, once the networks are done.
    pub generic: Option<GenericCodes>,
}

/// A keyframe's 32-D codes, the truth that every 15-D target is derived from.
pub(super) struct GenericCodes {
    pub width: u32,
    pub height: u32,
    /// `[height * width * 32]`; half precision, which moves a unit code by less than 0.0005.
    pub codes: Vec<f16>,
    /// The view at label resolution.
    pub camera: Camera,
    /// The 15-D codes on the device, and the version of the online stage that made them.
    pub target: LanguageTarget,
    pub version: u64,
}

impl Keyframe {
    /// # Errors
    /// When the device has no room for its images.
    pub fn new(
        gpu: &Gpu,
        tracked: &Tracked,
        frame: &Frame,
        train_width: u32,
    ) -> Result<Self, GpuError> {
        let world_from_camera = tracked.world_from_camera;
        let working = Working::of(frame, &world_from_camera, train_width);
        let size = (working.camera.width, working.camera.height);
        let target = ColorTarget::new(gpu, size, &working.rgb, &working.depth_metres)?;
        Ok(Self {
            frame: TrackedFrame {
                sequence: frame.sequence,
                timestamp_nanos: frame.timestamp_nanos,
                world_from_camera,
                exposure: tracked.seen_exposure(),
            },
            intrinsics: frame.intrinsics,
            rgb: frame.rgb.clone(),
            working,
            target,
            is_estimated: tracked.is_estimated,
            tracker_bytes: 0,
            moments: Moments::default(),
            steps: 0,
            generic: None,
        })
    }

    /// Memory of its pictures and codes, the device's too.
    pub fn bytes(&self) -> u64 {
        let generic = self.generic.as_ref().map_or(0, |generic| {
            size_of_val(&generic.codes[..]) as u64 + generic.target.device_bytes()
        });
        let is_shared = Arc::ptr_eq(&self.rgb, &self.working.rgb);
        let full = if is_shared { 0 } else { self.rgb.len() as u64 };
        full + self.working.bytes() + self.tracker_bytes + self.target.device_bytes() + generic
    }

    /// Moves it to another pose.
    pub fn place(&mut self, world_from_camera: &Isometry3<f64>) {
        self.frame.world_from_camera = *world_from_camera;
        self.frame.world_from_camera.rotation.renormalize();
        self.working.place(world_from_camera);
        if let Some(generic) = &mut self.generic {
            generic.camera.camera_from_world = self.working.camera.camera_from_world;
        }
    }

    /// The working image in the map's colors.
    pub fn in_map_colors(&self) -> Cow<'_, Working> {
        let [a, b] = self.frame.exposure;
        if [a, b] == [0.0; 2] {
            return Cow::Borrowed(&self.working);
        }
        let mut working = self.working.clone();
        let seen = |value: u8| (f32::from(value) / 255.0 - b) * (-a).exp() * 255.0;
        working.rgb = working.rgb.iter().map(|value| seen(*value).round() as u8).collect();
        Cow::Owned(working)
    }
}

impl Mapper {
    /// Whether the frame shows enough that no keyframe of the window shows, or was taken from far enough
    /// away; never of a frame that is held out. Every keyframe gets language, so that what is new in
    /// color is new in language (paper §4.3 asks for both). Asked of every keyframe with
    /// language, however old, there were fewer keyframes, and a lost camera believed a wrong place (measured).
    pub(super) fn is_keyframe(&self, frame: &Frame, pose: &Isometry3<f64>) -> bool {
        if frame.held_out {
            return false;
        }
        let Some(last) = self.keyframes.last() else { return true };
        let last_from_camera = last.frame.world_from_camera.inverse() * pose;
        let moved = last_from_camera.translation.vector.norm();
        let Some(median) = median_depth(&frame.depth_metres) else { return false };
        if moved > self.config.keyframe_translation * f64::from(median)
            || last_from_camera.rotation.angle() > self.config.keyframe_rotation_radians
        {
            return true;
        }
        let sample = Sample::of(&frame.intrinsics.camera(pose), &frame.depth_metres, SAMPLES);
        let newest = self.keyframes.iter().rev().take(self.config.window.max(1));
        sample.novelty(newest.map(|keyframe| &keyframe.working)) > self.config.keyframe_novelty
    }
}

/// Points of a picture's surface in the world.
pub(super) struct Sample(Vec<Point3<f32>>);

impl Sample {
    /// About so many, evenly spread.
    pub fn of(camera: &Camera, depth_metres: &[f32], points: f64) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let stride = ((width * height) as f64 / points).sqrt().ceil().max(1.0) as usize;
        let grid = |size| (stride / 2..size).step_by(stride);
        let points = grid(height).flat_map(|row| grid(width).map(move |column| (column, row)));
        let points = points.filter_map(|(column, row)| {
            let depth = depth_metres[row * width + column];
            (depth > 0.0).then(|| camera.unproject(column as f32, row as f32, depth))
        });
        Self(points.collect())
    }

    /// The share of the points that none of the pictures shows, 0 to 1.
    pub fn novelty<'a>(&self, pictures: impl Iterator<Item = &'a Working>) -> f64 {
        let pictures: Vec<&Working> = pictures.collect();
        let is_new = |point: &&Point3<f32>| !pictures.iter().any(|seen| seen.shows(point));
        self.0.iter().filter(is_new).count() as f64 / self.0.len().max(1) as f64
    }
}

/// The median of a sample of the measured depths, metres; `None` if nothing was measured.
fn median_depth(depth_metres: &[f32]) -> Option<f32> {
    let stride = (depth_metres.len() / 4096).max(1);
    let mut sample: Vec<f32> =
        depth_metres.iter().step_by(stride).copied().filter(|depth| *depth > 0.0).collect();
    let middle = sample.len() / 2;
    if sample.is_empty() {
        return None;
    }
    let (_, median, _) = sample.select_nth_unstable_by(middle, f32::total_cmp);
    Some(*median)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A wall 2 m away, of which this shows two metres, from so many metres to the right.
    pub fn wall(metres: f32) -> Working {
        let camera = Camera {
            width: 40,
            height: 30,
            fx: 40.0,
            fy: 40.0,
            cx: 19.5,
            cy: 14.5,
            camera_from_world: Isometry3::translation(-metres, 0.0, 0.0),
        };
        Working { camera, rgb: vec![128; 3600].into(), depth_metres: vec![2.0; 1200].into() }
    }

    #[test]
    fn what_no_picture_shows_is_new() {
        let here = wall(0.0);
        let sample = Sample::of(&here.camera, &here.depth_metres, SAMPLES);
        let (near, half, far) = (wall(0.1), wall(1.0), wall(5.0));
        let novelty = |pictures: &[&Working]| sample.novelty(pictures.iter().copied());
        assert_eq!((novelty(&[]), novelty(&[&far])), (1.0, 1.0));
        assert!(novelty(&[&far, &near]) < 0.1);
        assert!((novelty(&[&half]) - 0.5).abs() < 0.1, "half of it");
    }

    #[test]
    fn the_median_ignores_holes() {
        assert_eq!(median_depth(&[0.0, 0.0, 0.0, 1.0, 2.0, 9.0]), Some(2.0));
        assert_eq!(median_depth(&[0.0; 5]), None);
    }
}
