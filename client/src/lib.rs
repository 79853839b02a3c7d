#![doc = include_str!("../README.md")]

pub mod bench;
pub mod dataset;
pub mod evaluate;
pub mod http;
pub mod npy;
pub mod overlay;
pub mod stream;
pub mod synthetic;
