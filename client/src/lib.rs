//! Client library of lexsplat.

pub mod synthetic;
