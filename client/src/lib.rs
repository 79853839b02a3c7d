#![doc = include_str!("../README.md")]

mod access;
pub mod dataset;
pub mod http;
pub mod messages;
pub mod npy;
pub mod stream;

pub use access::{Access, AccessError, Identity};
