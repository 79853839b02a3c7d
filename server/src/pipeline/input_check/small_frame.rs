//! A frame as the checks of input see it: at most 160 columns of depth and brightness, and the pose as sent.

use super::super::downsampled_frame::DownsampledFrame;
use super::super::frame::Frame;
use super::super::quantile::median;
use super::super::saving::{CameraFields, packed};
use lexsplat_gpu::Camera;
use lexsplat_pictures::Grey;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Columns of the pictures that are compared.
const COLUMNS: u32 = 160;
/// Columns of the sample that tells whether a frame shows something new.
const GLANCE_COLUMNS: usize = 40;
/// Depths that differ by less than this share look the same.
const SAME_DEPTH: f32 = 0.03;
/// Brightnesses that differ by less than this, of 255, look the same.
const SAME_GREY: f32 = 15.0;
/// Two frames look alike if this share of their pixels looks the same, in depth and in brightness.
const ALIKE: f32 = 0.6;
/// A frame with less depth than this share of its pixels tells nothing.
const LEAST_DEPTH: f32 = 0.1;

/// A frame at reduced size.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct SmallFrame {
    /// Size and intrinsics; its pose is not used.
    #[serde(with = "CameraFields")]
    pub camera: Camera,
    /// `[height * width]` brightness, 0 to 255.
    #[serde(with = "packed")]
    pub grey: Vec<f32>,
    /// `[height * width]`, metres as sent; 0 where nothing was measured.
    #[serde(with = "packed")]
    pub depth_metres: Arc<[f32]>,
    /// The pose as sent; absent if the sender gave none that it believes in.
    pub world_from_camera: Option<Isometry3<f64>>,
}

impl SmallFrame {
    pub fn new(frame: &Frame) -> Self {
        let small = DownsampledFrame::new(frame, &Isometry3::identity(), COLUMNS);
        // A hint without covariance only places the first frame.
        let hint = frame.hint.as_ref().filter(|hint| hint.covariance.is_some());
        Self {
            grey: Grey::new(&small.picture()).values,
            camera: small.camera,
            depth_metres: small.depth_metres,
            world_from_camera: frame.world_from_camera.or(hint.map(|hint| hint.world_from_camera)),
        }
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.camera.width as usize, self.camera.height as usize)
    }

    /// The median of the measured depths, metres; `None` if there are none.
    pub fn median_depth_metres(&self) -> Option<f32> {
        let mut depths: Vec<f32> =
            self.depth_metres.iter().copied().filter(|depth| *depth > 0.0).collect();
        median(&mut depths)
    }
}

/// Every so many pixels of a frame, to tell cheaply whether another frame shows the same.
#[derive(Clone, Serialize, Deserialize)]
pub(super) struct Glance {
    /// Brightness, 0 to 255, and depth in metres of each sampled pixel.
    pixels: Vec<(f32, f32)>,
}

impl Glance {
    pub fn new(frame: &Frame) -> Self {
        let (width, height) = (frame.intrinsics.width as usize, frame.intrinsics.height as usize);
        let step = width.div_ceil(GLANCE_COLUMNS);
        let rows = (step / 2..height).step_by(step);
        let places = rows.flat_map(|row| {
            (step / 2..width).step_by(step).map(move |column| row * width + column)
        });
        let pixel = |at: usize| {
            // Green is most of the brightness.
            (f32::from(frame.rgb[at * 3 + 1]), frame.depth_metres[at])
        };
        Self { pixels: places.map(pixel).collect() }
    }

    /// Whether anything of the frame has a depth.
    pub fn has_any_depth(&self) -> bool {
        self.pixels.iter().any(|(_, depth)| *depth > 0.0)
    }

    /// Whether enough of the frame has a depth.
    pub fn has_depth(&self) -> bool {
        let measured = self.pixels.iter().filter(|(_, depth)| *depth > 0.0).count();
        measured as f32 >= LEAST_DEPTH * self.pixels.len() as f32
    }

    /// Whether a frame of the same camera has the very same depth. Measured depth never repeats by chance.
    pub fn has_depth_of(&self, other: &Self) -> bool {
        self.pixels.len() == other.pixels.len()
            && self.pixels.iter().zip(&other.pixels).all(|(a, b)| a.1 == b.1)
    }

    /// Whether depth is the same everywhere: a wall seen at a right angle by a renderer, or a made-up depth.
    pub fn is_flat(&self) -> bool {
        self.pixels.windows(2).all(|two| two[0].1 == two[1].1)
    }

    /// Root mean square of the difference of brightness to a frame of the same size, 0 to 255, that no gain
    /// and offset explain: another exposure is no change.
    pub fn brightness_change(&self, other: &Self) -> f32 {
        let count = self.pixels.len().max(1) as f32;
        let mean = |glance: &Self| glance.pixels.iter().map(|pixel| pixel.0).sum::<f32>() / count;
        let means = (mean(self), mean(other));
        let pairs = self.pixels.iter().zip(&other.pixels);
        let [own, both, others] = pairs.fold([0.0; 3], |[own, both, others], (a, b)| {
            let (a, b) = (a.0 - means.0, b.0 - means.1);
            [own + a * a, both + a * b, others + b * b]
        });
        let explained = if others > 0.0 { both * both / others } else { 0.0 };
        ((own - explained).max(0.0) / count).sqrt()
    }

    /// Whether a frame of the same camera looks the same from the same place: little has moved.
    pub fn is_like(&self, other: &Self) -> bool {
        let pairs = || self.pixels.iter().zip(&other.pixels);
        let mut steps: Vec<f32> = pairs().map(|(a, b)| a.0 - b.0).collect();
        // Another exposure is no motion.
        let Some(exposure) = median(&mut steps.clone()) else { return true };
        steps.retain(|step| (step - exposure).abs() < SAME_GREY);
        let measured = || pairs().filter(|(a, b)| a.1 > 0.0 && b.1 > 0.0);
        let same = measured().filter(|(a, b)| (a.1 - b.1).abs() < SAME_DEPTH * a.1).count();
        let is_most = |part: usize, whole: usize| part as f32 >= ALIKE * whole as f32;
        is_most(steps.len(), self.pixels.len()) && is_most(same, measured().count())
    }
}
