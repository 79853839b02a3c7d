//! How the state of a map is written by serde, where the standard way is too large or missing.

mod camera;
pub(super) mod packed;
pub(super) mod texts;

pub(super) use camera::CameraFields;
