//! The camera that a room is rendered with, and the pictures that it takes.

/// A pinhole camera; the centre of the top-left pixel is (0, 0).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Columns, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// Horizontal focal length, pixels.
    pub fx: f64,
    /// Vertical focal length, pixels.
    pub fy: f64,
    /// Column of the principal point, pixels.
    pub cx: f64,
    /// Row of the principal point, pixels.
    pub cy: f64,
}

impl Camera {
    /// A centred camera with square pixels and a horizontal field of view of 70 degrees.
    pub fn new(width: u32, height: u32) -> Self {
        let focal = f64::from(width) / 2.0 / 35.0_f64.to_radians().tan();
        Self {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: (f64::from(width) - 1.0) / 2.0,
            cy: (f64::from(height) - 1.0) / 2.0,
        }
    }
}

/// A rendered view: color, depth and instance of every pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Columns, pixels.
    pub width: u32,
    /// Rows, pixels.
    pub height: u32,
    /// sRGB, 3 bytes per pixel, row by row.
    pub rgb: Vec<u8>,
    /// Camera z at pixel centres, metres; 0 where nothing is hit.
    pub depth: Vec<f32>,
    /// Instance ids, 0 where nothing is hit.
    pub instances: Vec<u8>,
}
