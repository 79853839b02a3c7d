//! **Registration**: pictures as the cameras took them become pictures of one pinhole camera.
//!
//! In: color, which may be distorted, and depth, which may come from a camera of its own. Out: color without
//! distortion, and depth registered to it, with what is hidden left out. Pictures that are so already pass
//! unchanged.
//!
//! It is a package of its own because it computes for every pixel: it is optimised in each profile.

mod camera;
mod depth;
mod intrinsics;
mod lens;
mod rectification;

pub use camera::{Camera, Cameras, DepthCamera};
pub use intrinsics::Intrinsics;
pub use lens::Distortion;
pub use rectification::{LensError, pinhole};

use depth::DepthRays;
use nalgebra::Isometry3;
use rectification::Rectification;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

#[cfg(test)]
mod tests;

/// What was taken at one time.
#[derive(Clone, Debug)]
pub struct Pictures {
    /// The color camera.
    pub intrinsics: Intrinsics,
    /// `[height * width * 3]`, row-major RGB, 8 bit.
    pub rgb: Arc<[u8]>,
    /// `[height * width]` of the depth camera ([`Cameras::depth_size`]), camera z in metres; 0 is no
    /// measurement.
    pub depth_metres: Arc<[f32]>,
    /// `[height * width]`, a label for each pixel of color.
    pub labels: Option<Arc<[u16]>>,
}

/// Registers the pictures of a stream.
pub struct Registration {
    cameras: Cameras,
    /// The pinhole camera of pictures with the usual intrinsics.
    camera: Intrinsics,
    /// What was computed for the newest pictures' intrinsics.
    newest: Mutex<Option<Arc<Prepared>>>,
}

/// What is computed once for a color camera.
struct Prepared {
    own: Intrinsics,
    camera: Intrinsics,
    color: Option<Rectification>,
    depth: Option<DepthRays>,
}

impl Registration {
    /// # Errors
    /// [`LensError`] if color's lens cannot be straightened.
    pub fn new(cameras: Cameras) -> Result<Self, LensError> {
        let camera = pinhole(&cameras.color)?;
        Ok(Self { cameras, camera, newest: Mutex::new(None) })
    }

    /// The cameras as they are.
    pub fn cameras(&self) -> &Cameras {
        &self.cameras
    }

    /// The pinhole camera of registered pictures, unless they have intrinsics of their own.
    pub fn camera(&self) -> Intrinsics {
        self.camera
    }

    /// Pictures of a pinhole camera. This takes milliseconds.
    ///
    /// # Errors
    /// [`LensError`] if the pictures have intrinsics of their own with which the lens cannot be straightened.
    pub fn register(&self, raw: Pictures) -> Result<Pictures, LensError> {
        if self.cameras.depth.is_none() && self.cameras.color.distortion.is_none() {
            return Ok(raw);
        }
        let prepared = self.prepared(raw.intrinsics)?;
        let (rgb, labels) = match &prepared.color {
            Some(color) => (
                color.color(&raw.rgb).into(),
                raw.labels.map(|labels| color.labels(&labels).into()),
            ),
            None => (raw.rgb, raw.labels),
        };
        let depth_metres = match &prepared.depth {
            Some(rays) => rays.registered(&raw.depth_metres).into(),
            None => raw.depth_metres,
        };
        Ok(Pictures { intrinsics: prepared.camera, rgb, depth_metres, labels })
    }

    fn prepared(&self, own: Intrinsics) -> Result<Arc<Prepared>, LensError> {
        let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        match &*newest {
            Some(prepared) if prepared.own == own => Ok(prepared.clone()),
            _ => Ok(newest.insert(Arc::new(self.prepare(own)?)).clone()),
        }
    }

    fn prepare(&self, own: Intrinsics) -> Result<Prepared, LensError> {
        let color = Camera { intrinsics: own, ..self.cameras.color };
        let camera = pinhole(&color)?;
        let is_distorted = !color.distortion.is_none();
        Ok(Prepared {
            own,
            camera,
            color: is_distorted.then(|| Rectification::new(&color, &camera)),
            depth: self
                .cameras
                .depth_camera(&own)
                .map(|(depth, pose)| DepthRays::new(&depth, &pose, &camera)),
        })
    }
}

/// Depth of a pinhole camera as it is seen from another place: `[height * width]`, metres; 0 where nothing is
/// known. `there_from_here`: the pose of the camera that measured, in the coordinates of the other place.
pub fn depth_seen_from(
    depth_metres: &[f32],
    camera: &Intrinsics,
    there_from_here: &Isometry3<f64>,
) -> Vec<f32> {
    let straight = Camera { intrinsics: *camera, distortion: Distortion::None };
    DepthRays::new(&straight, there_from_here, camera).registered(depth_metres)
}

impl fmt::Debug for Registration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Registration").field(&self.cameras).finish()
    }
}
