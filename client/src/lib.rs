#![doc = include_str!("../README.md")]

mod access;
pub mod bags;
pub mod dataset;
pub mod http;
pub mod layout;
pub mod live;
pub mod messages;
pub mod npy;
pub mod rig;
pub mod stream;

pub use access::{Access, AccessError, Identity};
