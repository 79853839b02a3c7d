//! Color and depth of a pinhole camera.

/// A picture; it borrows its pixels.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    /// Columns, pixels.
    pub width: usize,
    /// Rows, pixels.
    pub height: usize,
    /// Focal lengths in columns and rows, pixels.
    pub focal: [f32; 2],
    /// Principal point, column and row; 0 is the middle of the first pixel.
    pub centre: [f32; 2],
    /// `[height * width * 3]`, row-major RGB, 8 bit.
    pub rgb: &'a [u8],
    /// `[height * width]`, metres; 0 where nothing was measured.
    pub depth_metres: &'a [f32],
}
