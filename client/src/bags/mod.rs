//! **Recordings of robots** as data sets: MCAP files, and bags of ROS 2.
//!
//! A file is read once when it is opened. Poses and calibrations are kept, and where the pictures lie;
//! pictures are read when a frame is asked for. [`rig`](crate::rig) chooses the topics. Recordings of
//! lexsplat's own server need no choice: they say how their frames are put together.

mod bag;
mod compressed;
mod files;
mod look;
mod mcap_file;
mod own;
mod sqlite;
mod store;

#[cfg(test)]
mod tests;

pub use bag::{mcap, rosbag2};
