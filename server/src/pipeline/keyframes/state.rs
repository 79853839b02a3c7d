//! A keyframe in host memory alone, to be kept and made again as it was.

use super::super::compressor::GENERIC_SIZE;
use super::super::downsampled_frame::DownsampledFrame;
use super::super::frame::{Intrinsics, TrackedFrame};
use super::super::pose_adam::PoseAdam;
use super::super::saving::{CameraFields, packed};
use super::super::up::Facet;
use super::keyframe::{Keyframe, color_target};
use super::language::KeyframeLanguage;
use super::thumbnail::Thumbnail;
use super::visits::Visits;
use super::windows::FullDepth;
use half::f16;
use half::slice::HalfFloatSliceExt as _;
use lexsplat_gpu::{Camera, Gpu, GpuError};
use lexsplat_pictures::Features;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// All that is known of a keyframe. Pictures are shared with it.
#[derive(Serialize, Deserialize)]
pub(in super::super) struct KeyframeState {
    frame: TrackedFrame,
    intrinsics: Intrinsics,
    /// The different ones of the received image, and those for training and for tracking, in this order.
    rgb: Vec<Rgb>,
    /// Which of them each image is.
    rgb_of: [usize; 3],
    /// The different ones of the depths for training and for tracking, in this order.
    depths: Vec<Depth>,
    depth_of: [usize; 2],
    #[serde(with = "CameraFields")]
    training: Camera,
    #[serde(with = "CameraFields")]
    tracking: Camera,
    full_depth: Option<HalfDepth>,
    map_exposure: [f64; 2],
    features: Features,
    thumbnail: Thumbnail,
    is_estimated: bool,
    is_connected: bool,
    pose_adam: PoseAdam,
    visits: Visits,
    /// Error of each tile of the training image, as the last steps found it.
    #[serde(with = "packed")]
    tile_errors: Vec<f32>,
    language: Option<LanguageState>,
    overlap_points: Vec<Point3<f64>>,
}

#[derive(Serialize, Deserialize)]
struct Rgb(#[serde(with = "packed")] Arc<[u8]>);

#[derive(Serialize, Deserialize)]
struct Depth(#[serde(with = "packed")] Arc<[f32]>);

/// The bits of half-precision depths.
#[derive(Serialize, Deserialize)]
struct HalfDepth(#[serde(with = "packed")] Vec<u16>);

#[derive(Serialize, Deserialize)]
struct LanguageState {
    #[serde(with = "CameraFields")]
    camera: Camera,
    /// The bits of the half-precision codes.
    #[serde(with = "packed")]
    codes: Vec<u16>,
}

impl KeyframeState {
    /// Reads a keyframe.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn of(keyframe: &Keyframe, gpu: &Gpu) -> Result<Self, GpuError> {
        let (training, tracking) = (&keyframe.training, &keyframe.tracking);
        let (rgb, rgb_of) = distinct([&keyframe.rgb, &training.rgb, &tracking.rgb]);
        let (depths, depth_of) = distinct([&training.depth_metres, &tracking.depth_metres]);
        let full_depth = keyframe.full_depth.as_ref();
        Ok(Self {
            frame: keyframe.frame,
            intrinsics: keyframe.intrinsics,
            rgb: rgb.into_iter().map(Rgb).collect(),
            rgb_of,
            depths: depths.into_iter().map(Depth).collect(),
            depth_of,
            training: training.camera.clone(),
            tracking: tracking.camera.clone(),
            full_depth: full_depth.map(|depth| HalfDepth(depth.0.reinterpret_cast().to_vec())),
            map_exposure: keyframe.map_exposure,
            features: keyframe.features.clone(),
            thumbnail: keyframe.thumbnail.clone(),
            is_estimated: keyframe.is_estimated,
            is_connected: keyframe.is_connected,
            pose_adam: keyframe.pose_adam.clone(),
            visits: keyframe.visits,
            tile_errors: keyframe.target.tile_errors(gpu)?,
            language: keyframe.language.as_ref().map(LanguageState::of),
            overlap_points: keyframe.overlap_points.clone(),
        })
    }

    /// Makes the keyframe.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`] if sizes do not fit together, [`GpuError::OutOfMemory`].
    pub fn keyframe(self, gpu: &Gpu) -> Result<Keyframe, GpuError> {
        let missing = || GpuError::ShapeMismatch { what: "pictures", expected: 1, found: 0 };
        let rgb = |of: usize| self.rgb.get(of).map(|rgb| rgb.0.clone()).ok_or_else(missing);
        let depth = |of: usize| self.depths.get(of).map(|one| one.0.clone()).ok_or_else(missing);
        let [received, training, tracking] = self.rgb_of;
        let training = DownsampledFrame {
            camera: self.training,
            rgb: rgb(training)?,
            depth_metres: depth(self.depth_of[0])?,
        };
        let tracking = DownsampledFrame {
            camera: self.tracking,
            rgb: rgb(tracking)?,
            depth_metres: depth(self.depth_of[1])?,
        };
        let target = color_target(&training)?;
        target.set_tile_errors(gpu, &self.tile_errors)?;
        let depths = |HalfDepth(bits)| bits.into_iter().map(f16::from_bits).collect();
        let full_depth = self.full_depth.map(|depth| FullDepth(depths(depth)));
        if let Some(FullDepth(depth)) = &full_depth {
            let expected = self.intrinsics.width as usize * self.intrinsics.height as usize;
            expect_pixels("full depth", expected, depth.len())?;
            expect_pixels("received rgb", 3 * expected, rgb(received)?.len())?;
        }
        Ok(Keyframe {
            frame: self.frame,
            intrinsics: self.intrinsics,
            rgb: rgb(received)?,
            training,
            target,
            full_depth,
            facets: Facet::sampled(&tracking),
            tracking,
            map_exposure: self.map_exposure,
            features: self.features,
            thumbnail: self.thumbnail,
            is_estimated: self.is_estimated,
            is_connected: self.is_connected,
            pose_adam: self.pose_adam,
            visits: self.visits,
            language: self.language.map(LanguageState::language).transpose()?,
            overlap_points: self.overlap_points,
        })
    }
}

impl LanguageState {
    fn of(language: &KeyframeLanguage) -> Self {
        Self {
            camera: language.camera.clone(),
            codes: language.codes.all().into_iter().map(f16::to_bits).collect(),
        }
    }

    fn language(self) -> Result<KeyframeLanguage, GpuError> {
        let [expected, found] = [self.camera.pixels() * GENERIC_SIZE, self.codes.len()];
        if expected != found {
            return Err(GpuError::ShapeMismatch { what: "codes", expected, found });
        }
        let codes = self.codes.into_iter().map(f16::from_bits).collect();
        Ok(KeyframeLanguage::of_codes(self.camera, codes))
    }
}

fn expect_pixels(what: &'static str, expected: usize, found: usize) -> Result<(), GpuError> {
    if expected == found { Ok(()) } else { Err(GpuError::ShapeMismatch { what, expected, found }) }
}

/// The arrays without those that are the same memory as an earlier one, and which of them each array is.
fn distinct<T, const N: usize>(arrays: [&Arc<[T]>; N]) -> (Vec<Arc<[T]>>, [usize; N]) {
    let mut distinct: Vec<Arc<[T]>> = Vec::new();
    let index = arrays.map(|array| {
        let known = distinct.iter().position(|other| Arc::ptr_eq(other, array));
        known.unwrap_or_else(|| {
            distinct.push(array.clone());
            distinct.len() - 1
        })
    });
    (distinct, index)
}
