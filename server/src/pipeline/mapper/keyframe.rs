//! Which frames become keyframes, and what is kept of them.

use super::super::frame::{Frame, Intrinsics};
use super::super::snapshot::TrackedFrame;
use super::Mapper;
use lexsplat_gpu::{Camera, ColourTarget, Gpu, GpuError, LanguageTarget};
use nalgebra::Isometry3;
use std::sync::Arc;

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
    /// Its language, once the networks are done.
    pub generic: Option<GenericCodes>,
}

/// A frame at working size.
pub(super) struct Working {
    pub camera: Camera,
    /// `[height * width * 3]`.
    pub rgb: Vec<u8>,
    /// `[height * width]`, metres, 0 none.
    pub depth_metres: Vec<f32>,
}

/// A keyframe's 32-D codes, the truth that every 15-D target is derived from.
pub(super) struct GenericCodes {
    pub width: u32,
    pub height: u32,
    /// `[height * width * 32]`.
    pub codes: Vec<f32>,
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
        tracked: TrackedFrame,
        frame: &Frame,
        train_width: u32,
    ) -> Result<Self, GpuError> {
        let working = shrink(frame, &tracked.world_from_camera, train_width);
        let size = (working.camera.width, working.camera.height);
        let target = ColourTarget::new(gpu, size, &working.rgb, &working.depth_metres)?;
        Ok(Self {
            frame: tracked,
            intrinsics: frame.intrinsics,
            rgb: frame.rgb.clone(),
            working,
            target,
            generic: None,
        })
    }
}

impl Mapper {
    /// Whether the camera has moved or turned enough since the last keyframe.
    pub(super) fn is_keyframe(&self, frame: &Frame, pose: &Isometry3<f64>) -> bool {
        let Some(last) = self.keyframes.last() else { return true };
        let last_from_camera = last.frame.world_from_camera.inverse() * pose;
        let moved = last_from_camera.translation.vector.norm();
        let Some(median) = median_depth(&frame.depth_metres) else { return false };
        moved > self.config.keyframe_translation * f64::from(median)
            || last_from_camera.rotation.angle() > self.config.keyframe_rotation_radians
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

/// The frame by a whole-numbered factor smaller, so that it has at most `train_width` columns:
/// colour is averaged, depth is the nearest measurement in each block (averages would invent points
/// between surfaces). Rows and columns that do not fill a block are left out.
fn shrink(frame: &Frame, world_from_camera: &Isometry3<f64>, train_width: u32) -> Working {
    let full = frame.intrinsics.camera(world_from_camera);
    let factor = full.width.div_ceil(train_width.max(1)).max(1) as usize;
    let (width, height) =
        ((full.width as usize / factor).max(1), (full.height as usize / factor).max(1));
    if factor == 1 {
        return Working {
            camera: full,
            rgb: frame.rgb.to_vec(),
            depth_metres: frame.depth_metres.to_vec(),
        };
    }
    let scale = 1.0 / factor as f32;
    let camera = Camera {
        width: width as u32,
        height: height as u32,
        fx: full.fx * scale,
        fy: full.fy * scale,
        cx: (full.cx + 0.5) * scale - 0.5,
        cy: (full.cy + 0.5) * scale - 0.5,
        camera_from_world: full.camera_from_world,
    };
    let stride = full.width as usize;
    let mut rgb = Vec::with_capacity(width * height * 3);
    let mut depth_metres = Vec::with_capacity(width * height);
    for row in 0..height {
        for column in 0..width {
            let mut sum = [0u32; 3];
            let mut nearest = f32::INFINITY;
            for y in row * factor..(row + 1) * factor {
                for x in column * factor..(column + 1) * factor {
                    let at = y * stride + x;
                    for (channel, sum) in sum.iter_mut().enumerate() {
                        *sum += u32::from(frame.rgb[at * 3 + channel]);
                    }
                    let depth = frame.depth_metres[at];
                    if depth > 0.0 {
                        nearest = nearest.min(depth);
                    }
                }
            }
            let pixels = (factor * factor) as u32;
            rgb.extend(sum.map(|sum| ((sum + pixels / 2) / pixels) as u8));
            depth_metres.push(if nearest.is_finite() { nearest } else { 0.0 });
        }
    }
    Working { camera, rgb, depth_metres }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame whose columns differ in colour, with one hole and one near pixel.
    fn frame(width: u32, height: u32) -> Frame {
        let pixels = (width * height) as usize;
        let mut depth_metres = vec![3.0; pixels];
        depth_metres[0] = 0.0;
        depth_metres[1] = 1.0;
        let column = |at: usize| (at as u32 % width) as u8;
        Frame {
            sequence: 0,
            timestamp_nanos: 0,
            intrinsics: Intrinsics { width, height, fx: 10.0, fy: 10.0, cx: 3.5, cy: 1.5 },
            rgb: (0..pixels).flat_map(|at| [column(at), 100, 200]).collect(),
            depth_metres: depth_metres.into(),
            world_from_camera: Some(Isometry3::identity()),
        }
    }

    #[test]
    fn shrinking_averages_colour_and_keeps_the_nearest_depth() {
        let working = shrink(&frame(8, 4), &Isometry3::identity(), 4);
        assert_eq!((working.camera.width, working.camera.height), (4, 2));
        assert_eq!(working.rgb[..3], [1, 100, 200], "columns 0 and 1: 0.5, rounded up");
        assert_eq!(working.depth_metres[0], 1.0, "the nearest, not the mean of 0, 1, 3 and 3");
        assert_eq!(working.depth_metres[1], 3.0);
    }

    #[test]
    fn shrinking_keeps_points_where_they_are() {
        let full = frame(8, 4).intrinsics.camera(&Isometry3::identity());
        let small = shrink(&frame(8, 4), &Isometry3::identity(), 4).camera;
        // The middle of the four top-left pixels is the middle of the small image's first pixel.
        let seen = full.unproject(0.5, 0.5, 2.0);
        let (u, v, _) = small.project(&seen).expect("it is in front of the camera");
        assert!(u.abs() < 1e-5 && v.abs() < 1e-5, "({u}, {v}) should be (0, 0)");
        let (wrong, _, _) = small.project(&full.unproject(0.0, 0.0, 2.0)).expect("in front");
        assert!(wrong.abs() > 0.1, "and the corner pixel alone is not");
    }

    #[test]
    fn small_frames_stay_as_they_are() {
        let working = shrink(&frame(8, 4), &Isometry3::identity(), 8);
        assert_eq!((working.camera.width, working.camera.height), (8, 4));
        assert_eq!(working.depth_metres[0], 0.0);
    }

    #[test]
    fn the_median_ignores_holes() {
        assert_eq!(median_depth(&[0.0, 0.0, 0.0, 1.0, 2.0, 9.0]), Some(2.0));
        assert_eq!(median_depth(&[0.0; 5]), None);
    }
}
