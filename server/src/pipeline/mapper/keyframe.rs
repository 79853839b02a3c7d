//! Which frames become keyframes, and what is kept of them.

use super::super::frame::{Frame, Intrinsics};
use super::super::snapshot::TrackedFrame;
use super::super::tracker::{Moments, Tracked};
use super::super::working::Working;
use super::Mapper;
use half::f16;
use lexsplat_gpu::{Camera, ColourTarget, Gpu, GpuError, LanguageTarget};
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
    pub target: ColourTarget,
    /// Whether its pose is the tracker's own, so that it may be refined.
    pub is_estimated: bool,
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
        let target = ColourTarget::new(gpu, size, &working.rgb, &working.depth_metres)?;
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
            moments: Moments::default(),
            steps: 0,
            generic: None,
        })
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

    /// The working image in the map's colours.
    pub fn in_map_colours(&self) -> Cow<'_, Working> {
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
    /// colour is new in language (paper §5 asks for both).
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
        let sample = Sample::of(frame, pose);
        let newest = self.keyframes.iter().rev().take(self.config.window.max(1));
        sample.novelty(newest) > self.config.keyframe_novelty
    }
}

/// Points of a frame's surface in the world.
struct Sample(Vec<Point3<f32>>);

impl Sample {
    /// About a thousand, evenly spread.
    fn of(frame: &Frame, world_from_camera: &Isometry3<f64>) -> Self {
        let camera = frame.intrinsics.camera(world_from_camera);
        let (width, height) = (camera.width as usize, camera.height as usize);
        let stride = ((width * height) as f64 / SAMPLES).sqrt().ceil().max(1.0) as usize;
        let grid = |size| (stride / 2..size).step_by(stride);
        let points = grid(height).flat_map(|row| grid(width).map(move |column| (column, row)));
        let points = points.filter_map(|(column, row)| {
            let depth = frame.depth_metres[row * width + column];
            (depth > 0.0).then(|| camera.unproject(column as f32, row as f32, depth))
        });
        Self(points.collect())
    }

    /// The share of the points that none of the keyframes shows, 0 to 1.
    fn novelty<'a>(&self, keyframes: impl Iterator<Item = &'a Keyframe>) -> f64 {
        let keyframes: Vec<&Working> = keyframes.map(|keyframe| &keyframe.working).collect();
        let is_new = |point: &&Point3<f32>| !keyframes.iter().any(|seen| seen.shows(point));
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
mod tests {
    use super::*;

    #[test]
    fn the_median_ignores_holes() {
        assert_eq!(median_depth(&[0.0, 0.0, 0.0, 1.0, 2.0, 9.0]), Some(2.0));
        assert_eq!(median_depth(&[0.0; 5]), None);
    }
}
