//! Language codes of a mesh's vertices: means over the views that see them.

use super::{Mesh, View};
use lexsplat_gpu::LanguageImage;
use nalgebra::Point3;
use rayon::prelude::*;

/// Opacity of the language head below which a pixel says nothing.
const LEAST_OPACITY: f32 = 0.5;
/// How far behind the measured surface, in voxels, a vertex still is that surface.
const SEEN_VOXELS: f32 = 2.0;

/// Sums of codes, view by view.
pub(super) struct Painter<'a> {
    positions: &'a [Point3<f32>],
    size: usize,
    /// `[vertices * size]`.
    sums: Vec<f32>,
    /// Views that said something, `[vertices]`.
    views: Vec<f32>,
}

impl<'a> Painter<'a> {
    /// Nothing said yet.
    pub(super) fn new(mesh: &'a Mesh, size: usize) -> Self {
        let count = mesh.positions.len();
        Self {
            positions: &mesh.positions,
            size,
            sums: vec![0.0; count * size],
            views: vec![0.0; count],
        }
    }

    /// Adds a view's codes to the vertices that it sees.
    pub(super) fn add(&mut self, view: &View, image: &LanguageImage, voxel_metres: f32) {
        let rows = self.sums.par_chunks_exact_mut(self.size).zip(&mut self.views);
        rows.zip(self.positions).for_each(|((sum, views), position)| {
            let point = view.camera.camera_from_world * position;
            let Some(pixel) = view.pixel(&point) else { return };
            let (depth, opacity) = (view.depth[pixel], image.opacity[pixel]);
            let hidden = (point.z - depth).abs() > SEEN_VOXELS * voxel_metres;
            if depth <= 0.0 || hidden || opacity < LEAST_OPACITY {
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

    /// Mean codes and their length.
    pub(super) fn finish(mut self) -> (Vec<f32>, usize) {
        for (sum, views) in self.sums.chunks_exact_mut(self.size).zip(self.views) {
            sum.iter_mut().for_each(|sum| *sum /= views.max(1.0));
        }
        (self.sums, self.size)
    }
}
