//! One file per command of `lexsplat`.

pub mod ablate;
pub mod bench;
pub mod bridge;
pub mod demo;
pub mod evaluate;
pub mod export;
pub mod inspect;
pub mod maps;
mod measure;
pub mod query;
mod segment;
pub mod shell;
pub mod stream;
pub mod synth;
mod versus;
