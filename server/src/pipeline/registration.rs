//! **Registration** of frames, of whose pictures the package `lexsplat-registration` takes care.

use super::frame::{Frame, Labels};
pub use lexsplat_registration::{Camera, Cameras, DepthCamera, Distortion, Registration, pinhole};
use lexsplat_registration::{LensError, Pictures, depth_seen_from};
use nalgebra::Isometry3;

/// A checked frame as the cameras took it: `intrinsics` is the distorted color camera, and depth has the
/// size of [`Cameras::depth_size`].
#[derive(Clone, Debug)]
pub struct RawFrame(pub Frame);

/// The frame of a pinhole camera. This takes milliseconds.
///
/// # Errors
/// [`LensError`] if the lens cannot be straightened with the frame's own intrinsics.
pub fn registered(
    RawFrame(frame): RawFrame,
    registration: &Registration,
) -> Result<Frame, LensError> {
    let (ids, texts) = frame.labels.map(|Labels { ids, texts }| (ids, texts)).unzip();
    let raw = Pictures {
        intrinsics: frame.intrinsics,
        rgb: frame.rgb,
        depth_metres: frame.depth_metres,
        labels: ids,
    };
    let Pictures { intrinsics, rgb, depth_metres, labels } = registration.register(raw)?;
    let labels = labels.zip(texts).map(|(ids, texts)| Labels { ids, texts });
    Ok(Frame { intrinsics, rgb, depth_metres, labels, ..frame })
}

/// A registered frame, its depth as seen from where the camera was when color was taken.
/// `color_from_depth`: the pose of the camera at the time of depth, in the coordinates of the camera at the
/// time of color.
pub(super) fn at_one_time(frame: Frame, color_from_depth: &Isometry3<f64>) -> Frame {
    let depth = depth_seen_from(&frame.depth_metres, &frame.intrinsics, color_from_depth);
    Frame { depth_metres: depth.into(), depth_lag_nanos: 0, ..frame }
}
