//! The cameras of a stream, and the pixels that their rays go through.

use super::intrinsics::Intrinsics;
use super::lens::{Distortion, Lens};
use nalgebra::Isometry3;

/// A camera with its lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Size, focal lengths and principal point of the distorted picture.
    pub intrinsics: Intrinsics,
    /// Distortion of the lens.
    pub distortion: Distortion,
}

/// The camera that depth is taken with, where it is not color's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthCamera {
    /// Color's own lens at another resolution.
    SameLens {
        /// Columns of depth, pixels.
        width: u32,
        /// Rows of depth, pixels.
        height: u32,
    },
    /// A camera of its own.
    Own {
        /// Size, intrinsics and distortion.
        camera: Camera,
        /// Its pose in the coordinates of the color camera, metres.
        color_from_depth: Isometry3<f64>,
    },
}

/// The cameras of a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cameras {
    /// The color camera.
    pub color: Camera,
    /// The depth camera; `None`: depth is registered to color, and distorted like it.
    pub depth: Option<DepthCamera>,
}

impl Cameras {
    /// Columns and rows of depth as it is sent, pixels.
    pub fn depth_size(&self) -> (u32, u32) {
        match self.depth {
            None => (self.color.intrinsics.width, self.color.intrinsics.height),
            Some(DepthCamera::SameLens { width, height }) => (width, height),
            Some(DepthCamera::Own { camera, .. }) => {
                (camera.intrinsics.width, camera.intrinsics.height)
            }
        }
    }

    /// The depth camera and its pose in the coordinates of the color camera, where color's intrinsics are
    /// `own`; `None` if its pictures are those of the pinhole camera `own` already.
    pub(super) fn depth_camera(&self, own: &Intrinsics) -> Option<(Camera, Isometry3<f64>)> {
        let color = Camera { intrinsics: *own, ..self.color };
        match self.depth {
            Some(DepthCamera::Own { camera, color_from_depth }) => Some((camera, color_from_depth)),
            Some(DepthCamera::SameLens { width, height })
                if (width, height) != (own.width, own.height) =>
            {
                let intrinsics = own.scaled(width, height);
                Some((Camera { intrinsics, ..color }, Isometry3::identity()))
            }
            _ if color.distortion.is_none() => None,
            _ => Some((color, Isometry3::identity())),
        }
    }
}

/// A camera that is ready to compute.
pub(super) struct Optics {
    intrinsics: Intrinsics,
    lens: Lens,
}

impl Optics {
    pub fn new(camera: &Camera) -> Self {
        Self { intrinsics: camera.intrinsics, lens: Lens::new(camera.distortion) }
    }

    /// The ray through a pixel, as its point on the plane z = 1; `None` if none goes there.
    pub fn ray(&self, [column, row]: [f64; 2]) -> Option<[f64; 2]> {
        let Intrinsics { fx, fy, cx, cy, .. } = self.intrinsics;
        self.lens.undistorted([(column - cx) / fx, (row - cy) / fy])
    }

    /// The pixel that a ray goes through, perhaps outside the picture; `None` if the lens does not let it in.
    pub fn pixel(&self, ray: [f64; 2]) -> Option<[f64; 2]> {
        let Intrinsics { fx, fy, cx, cy, .. } = self.intrinsics;
        let [x, y] = self.lens.distorted(ray)?;
        Some([fx * x + cx, fy * y + cy])
    }

    /// Whether the lens is one-to-one around a ray.
    pub fn is_one_to_one(&self, ray: [f64; 2]) -> bool {
        self.lens.is_one_to_one(ray)
    }

    /// Whether a ray goes through the picture, up to the centres of its outermost pixels.
    pub fn sees(&self, ray: [f64; 2]) -> bool {
        // The centres are met up to rounding.
        const SLACK: f64 = 1e-6;
        let Intrinsics { width, height, .. } = self.intrinsics;
        let inside = |at: f64, side: u32| (-SLACK..=f64::from(side) - 1.0 + SLACK).contains(&at);
        self.pixel(ray).is_some_and(|[column, row]| inside(column, width) && inside(row, height))
    }
}
