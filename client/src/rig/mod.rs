//! A **rig**: topics of a robot put together to RGB-D frames with cameras and poses.
//!
//! A [`Survey`] looks at the messages of every topic. [`Rig::of`] chooses a color topic, a depth topic,
//! their calibrations and the source of poses by what the topics hold, or as [`Wanted`] says, and tells
//! what it chose in [`Rig::notes`]. Then [`pair`] finds the depth of each color picture, and
//! [`frame_pictures`] makes a frame's pictures of both. Nothing here knows files or networks: recordings
//! are read with it, and so may live messages be.

mod cameras;
mod choice;
mod error;
mod pairs;
mod poses;
mod robot;
mod survey;
mod track;
mod tree;
mod wanted;

#[cfg(test)]
mod tests;

pub use error::RigError;
pub use pairs::{pair, window};
pub use robot::{Rig, frame_pictures};
pub use survey::Survey;
pub use wanted::Wanted;
