//! Rendered images, and measurements on them.

use crate::device::Buffer;
use crate::shader::layout::{PixelState, Row};

/// A rendered view, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green, blue over black; height x width x 3.
    pub rgb: Vec<f32>,
    /// Blended z in metres, not divided by opacity; height x width.
    pub depth: Vec<f32>,
    /// One minus the light that passes; height x width.
    pub opacity: Vec<f32>,
}

/// Rendered language codes, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct LanguageImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Length of a code.
    pub channels: usize,
    /// Blended codes, not divided by opacity; height x width x channels.
    pub codes: Vec<f32>,
    /// One minus the light that passes the language head; height x width.
    pub opacity: Vec<f32>,
}

/// How much work a color picture is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Workload {
    /// Visible Gaussians.
    pub visible: usize,
    /// (Gaussian, tile) pairs.
    pub hits: usize,
    /// Gaussians evaluated at pixels: a tile's list up to where its last pixel is full, times the
    /// tile's pixels.
    pub evaluations: u64,
}

/// A rendered view on the device, until the renderer is used again.
#[derive(Clone, Copy)]
pub struct Drawn<'a> {
    /// Red, green, blue over black and blended z in metres, not divided by opacity; height x width.
    pub image: &'a Buffer<Row>,
    /// Light that passes; height x width.
    pub pixels: &'a Buffer<PixelState>,
}

/// What one Gaussian contributes to an image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Contribution {
    /// Sum over pixels of its blending weight.
    pub weight: f32,
    /// Pixels that it reaches with more than half of the light left behind it.
    pub touched_pixels: f32,
}
