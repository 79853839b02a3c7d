#![doc = include_str!("../README.md")]

pub mod dataset;
pub mod http;
pub mod npy;
pub mod stream;
