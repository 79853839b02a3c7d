//! **Registration**: frames as the cameras took them become frames of one pinhole camera.
//!
//! In: a [`RawFrame`], whose color may be distorted, and whose depth may come from a camera of its own.
//! Out: a [`Frame`] without distortion, its depth registered to color with what is hidden left out. Frames
//! that are so already pass unchanged.

mod camera;
mod depth;
mod lens;
mod rectification;

pub use camera::{Camera, Cameras, DepthCamera};
pub use lens::Distortion;
pub use rectification::{LensError, pinhole};

use super::frame::{Frame, Intrinsics, Labels};
use depth::DepthRays;
use nalgebra::Isometry3;
use rectification::Rectification;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

#[cfg(test)]
mod tests;

/// A checked frame as the cameras took it: `intrinsics` is the distorted color camera, and depth has the
/// size of [`Cameras::depth_size`].
#[derive(Clone, Debug)]
pub struct RawFrame(pub Frame);

/// Registers the frames of a stream.
pub struct Registration {
    cameras: Cameras,
    /// The pinhole camera of a frame with the usual intrinsics.
    camera: Intrinsics,
    /// What was computed for the newest frame's intrinsics.
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

    /// The cameras of the frames as they are sent.
    pub fn cameras(&self) -> &Cameras {
        &self.cameras
    }

    /// The pinhole camera of registered frames, unless a frame has intrinsics of its own.
    pub fn camera(&self) -> Intrinsics {
        self.camera
    }

    /// A frame of a pinhole camera. This takes milliseconds.
    ///
    /// # Errors
    /// [`LensError`] if the frame has intrinsics of its own with which the lens cannot be straightened.
    pub fn register(&self, raw: RawFrame) -> Result<Frame, LensError> {
        let frame = raw.0;
        if self.cameras.depth.is_none() && self.cameras.color.distortion.is_none() {
            return Ok(frame);
        }
        let prepared = self.prepared(frame.intrinsics)?;
        let Prepared { camera, color, depth, .. } = &*prepared;
        let rgb = match color {
            Some(color) => color.color(&frame.rgb).into(),
            None => frame.rgb,
        };
        let depth_metres = match depth {
            Some(rays) => rays.registered(&frame.depth_metres).into(),
            None => frame.depth_metres,
        };
        let labels = match (color, frame.labels) {
            (Some(color), Some(Labels { ids, texts })) => {
                Some(Labels { ids: color.labels(&ids).into(), texts })
            }
            (_, labels) => labels,
        };
        Ok(Frame { intrinsics: *camera, rgb, depth_metres, labels, ..frame })
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

/// A registered frame, its depth as seen from where the camera was when color was taken.
/// `color_from_depth`: the pose of the camera at the time of depth, in the coordinates of the camera at the
/// time of color.
pub(super) fn at_one_time(frame: Frame, color_from_depth: &Isometry3<f64>) -> Frame {
    let camera = Camera { intrinsics: frame.intrinsics, distortion: Distortion::None };
    let rays = DepthRays::new(&camera, color_from_depth, &frame.intrinsics);
    let depth_metres = rays.registered(&frame.depth_metres).into();
    Frame { depth_metres, depth_lag_nanos: 0, ..frame }
}

impl fmt::Debug for Registration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Registration").field(&self.cameras).finish()
    }
}
