//! RGB-D **data sets**: one trait, [`Dataset`], and a reader for each layout of folders.
//!
//! Frames are as the server takes them: color as JPEG or PNG bytes, depth as 16-bit PNG bytes in
//! units of [`Dataset::depth_unit_metres`], `world_from_camera` in metres (camera x right, y down,
//! z forward). [`Truth`] is ground truth about the objects; mapping does not need it. Nothing here
//! talks to a server.

mod against;
mod decoded;
mod described;
mod error;
mod files;
mod folder;
mod frame;
mod inflate;
mod inspect;
mod kinect;
mod layer;
mod name;
mod natural;
mod nerfstudio;
mod numbered;
mod part;
mod picture_files;
mod pose;
mod posed;
mod prepare;
mod r3d;
mod range;
mod recording;
mod replica;
mod root;
mod scannet;
mod seven_scenes;
mod source;
mod text;
mod timed;
mod truth;
mod tum;

#[cfg(test)]
pub(crate) mod tests;

pub use against::Against;
pub use error::DatasetError;
pub use folder::Folder;
pub use frame::{
    Camera, Cameras, Color, ColorFormat, Depth, DepthCamera, DepthFormat, Distortion, FrameExtras,
    FrameRate, Intrinsics, Moment, RgbdFrame, counted_nanos,
};
pub use inspect::{DepthCameraSeen, DepthSeen, DistortionSeen, Inspection, inspect};
pub use layer::Layer;
pub(crate) use name::{is_map_name, of as name_of};
pub(crate) use natural::natural_order;
pub use nerfstudio::Nerfstudio;
pub use posed::with_poses;
pub use r3d::R3d;
pub use range::FrameRange;
pub(crate) use recording::{Pictures, Recording, Shot};
pub use replica::Replica;
pub use root::Root;
pub use scannet::ScanNet;
pub use seven_scenes::SevenScenes;
pub use source::Dataset;
pub use text::shown;
pub use truth::{Instance, Mask, Truth};
pub use tum::Tum;
