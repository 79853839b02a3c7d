//! **Live**: frames from a robot's WebSocket to a server, while they are taken.
//!
//! [`bridge()`] subscribes to a robot that speaks Foxglove's WebSocket protocol (`foxglove_bridge` of ROS
//! 2, the servers of Foxglove's SDK), puts its topics together with [`rig`](crate::rig), and streams frames
//! into a map. It connects again when the robot or the server goes away, and goes on after the last
//! acknowledged frame.

mod board;
mod bridge;
mod connect;
mod intake;
mod options;
mod protocol;
mod robot;
mod sink;

#[cfg(test)]
mod tests;

pub use board::{BridgeEvent, BridgeProgress};
pub use bridge::bridge;
pub use options::{BridgeError, BridgeOptions};
