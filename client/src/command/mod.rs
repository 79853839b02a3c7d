//! One file per command of `lexsplat`.

pub mod synth;
