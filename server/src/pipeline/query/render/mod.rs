//! Rendering of snapshots.

mod color;
mod image;
mod palette;
mod scene;

pub(super) use image::{depth, render};
pub(super) use palette::PaletteCache;
pub(super) use scene::Scene;
