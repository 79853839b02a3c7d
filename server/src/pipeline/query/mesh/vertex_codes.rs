//! Language codes of a mesh's vertices: means over the views that see them.

use super::depth_view::DepthView;
use lexsplat_gpu::LanguageImage;
use nalgebra::Point3;
use rayon::prelude::*;

/// Opacity of the language head below which a pixel has no language.
const MIN_OPACITY: f32 = 0.5;
/// Distance from the rendered depth up to which a vertex is visible, voxels.
const VISIBLE_VOXELS: f32 = 2.0;

/// Sums of codes over views.
pub(super) struct VertexCodes<'a> {
    positions: &'a [Point3<f32>],
    size: usize,
    /// `[vertices * size]`.
    sums: Vec<f32>,
    /// Number of views with language, `[vertices]`.
    views: Vec<f32>,
}

impl<'a> VertexCodes<'a> {
    /// Zeros for vertices at these positions; `size` is the number of channels of a code.
    pub(super) fn new(positions: &'a [Point3<f32>], size: usize) -> Self {
        let count = positions.len();
        Self { positions, size, sums: vec![0.0; count * size], views: vec![0.0; count] }
    }

    /// Adds the codes of a view to the vertices that it sees.
    pub(super) fn add(&mut self, view: &DepthView, image: &LanguageImage, voxel_metres: f32) {
        let rows = self.sums.par_chunks_exact_mut(self.size).zip(&mut self.views);
        rows.zip(self.positions).for_each(|((sum, views), position)| {
            let point = view.camera.camera_from_world * position;
            let Some(pixel) = view.pixel(&point) else { return };
            let (depth, opacity) = (view.depth[pixel], image.opacity[pixel]);
            let hidden = (point.z - depth).abs() > VISIBLE_VOXELS * voxel_metres;
            if depth <= 0.0 || hidden || opacity < MIN_OPACITY {
                return;
            }
            let code = &image.codes[pixel * image.channels..][..image.channels];
            if code.iter().all(|&value| value == 0.0) {
                return;
            }
            sum.iter_mut().zip(code).for_each(|(sum, value)| *sum += value / opacity);
            *views += 1.0;
        });
    }

    /// Mean codes, `[vertices * size]`; zeros for vertices without language.
    pub(super) fn means(mut self) -> Vec<f32> {
        for (sum, views) in self.sums.chunks_exact_mut(self.size).zip(self.views) {
            sum.iter_mut().for_each(|sum| *sum /= views.max(1.0));
        }
        self.sums
    }
}
