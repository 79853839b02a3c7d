//! What the last training views saw of each Gaussian. Lives with the map, survives surgery, and is
//! zero for newborns.

use crate::shader::layout::Row;

/// What was seen of one Gaussian since its statistics were cleared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Sum over views of |dL/du|, u being its place on the screen in units of half the image's
    /// width and height.
    pub gradient_sum: f32,
    /// Number of views that saw it.
    pub views: f32,
    /// Largest radius on the screen, pixels.
    pub largest_radius: f32,
    /// Sum of its blending weights over pixels and views.
    pub weight_sum: f32,
    /// Number of pixels behind whose hit more than half of the light was left.
    pub touched_pixels: f32,
    /// Its largest blending weight, in [0, 1]; zero if it is not known.
    pub largest_weight: f32,
}

impl Statistics {
    /// Rows per Gaussian.
    pub const ROWS: usize = 2;

    /// As the device holds it: gradient sum, views, radius, 0; weight sum, pixels, weight, 0.
    pub fn to_rows(&self) -> [Row; Self::ROWS] {
        [
            [self.gradient_sum, self.views, self.largest_radius, 0.0],
            [self.weight_sum, self.touched_pixels, self.largest_weight, 0.0],
        ]
    }

    /// Undoes [`Statistics::to_rows`].
    pub fn from_rows([first, second]: [Row; Self::ROWS]) -> Self {
        Self {
            gradient_sum: first[0],
            views: first[1],
            largest_radius: first[2],
            weight_sum: second[0],
            touched_pixels: second[1],
            largest_weight: second[2],
        }
    }
}
