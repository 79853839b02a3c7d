//! Pinhole intrinsics.

use serde::{Deserialize, Serialize};

/// Pinhole intrinsics in pixels; the centre of the top-left pixel is (0, 0).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Intrinsics {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Focal length in x, pixels, > 0.
    pub fx: f64,
    /// Focal length in y, pixels, > 0.
    pub fy: f64,
    /// Principal point, column.
    pub cx: f64,
    /// Principal point, row.
    pub cy: f64,
}

impl Intrinsics {
    /// The same lens in a picture of another size: pixel edges stay edges.
    pub fn scaled(&self, width: u32, height: u32) -> Self {
        let x = f64::from(width) / f64::from(self.width);
        let y = f64::from(height) / f64::from(self.height);
        Self {
            width,
            height,
            fx: self.fx * x,
            fy: self.fy * y,
            cx: (self.cx + 0.5) * x - 0.5,
            cy: (self.cy + 0.5) * y - 0.5,
        }
    }
}
