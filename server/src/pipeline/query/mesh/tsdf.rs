//! Truncated signed distance field (Curless and Levoy 1996; KinectFusion).
//!
//! In: depths in metres and colors of views. Only blocks of 8x8x8 voxels near surfaces are stored,
//! within a limit of memory. The distance of a voxel is measured from its centre to the surface
//! along the camera's z axis, divided by the truncation, and averaged over views with equal
//! weights. It is positive in front of the surface. Voxels farther behind it than the truncation
//! are not updated.

use super::depth_view::DepthView;
use nalgebra::Point3;
use rayon::prelude::*;
use std::collections::HashMap;

/// Voxels along an edge of a block.
pub(super) const SIDE: usize = 8;
/// Voxels in a block.
const BLOCK: usize = SIDE * SIDE * SIDE;
/// Truncation in voxels. The paper's code has five; rendered depth is smooth, and four separates
/// thin objects better.
const TRUNCATION_VOXELS: f32 = 4.0;
/// Distance of the points along a ray at which blocks are allocated, voxels.
const RAY_STEP_VOXELS: f32 = 2.0;

/// A voxel.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Voxel {
    /// Divided by the truncation, at most 1; positive in front of the surface.
    pub distance: f32,
    /// Number of views; 0: unknown.
    pub weight: f32,
    /// Mean color over the views in which it is near the surface.
    pub rgb: [f32; 3],
    /// Number of these views.
    pub colored: f32,
}

struct Block {
    at: [i32; 3],
    voxels: Vec<Voxel>,
}

/// Blocks of voxels near surfaces.
pub(super) struct Tsdf {
    /// Side of a voxel, metres.
    voxel: f32,
    limit_blocks: usize,
    blocks: Vec<Block>,
    index: HashMap<[i32; 3], usize>,
}

/// The memory limit is reached.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Full;

impl Tsdf {
    /// An empty field of at most `limit_bytes`.
    pub(super) fn new(voxel: f32, limit_bytes: usize) -> Self {
        let limit_blocks = limit_bytes / (BLOCK * size_of::<Voxel>());
        Self { voxel, limit_blocks, blocks: Vec::new(), index: HashMap::new() }
    }

    /// Side of a voxel, metres.
    pub(super) fn voxel_metres(&self) -> f32 {
        self.voxel
    }

    /// Truncation: distances are stored up to so far from a surface, metres.
    pub(super) fn truncation_metres(&self) -> f32 {
        self.voxel * TRUNCATION_VOXELS
    }

    /// Positions of the blocks, in units of blocks.
    pub(super) fn blocks(&self) -> impl IndexedParallelIterator<Item = [i32; 3]> + '_ {
        self.blocks.par_iter().map(|block| block.at)
    }

    /// The voxel at a position in units of voxels; `None` if it is unknown.
    pub(super) fn voxel(&self, at: [i32; 3]) -> Option<&Voxel> {
        let side = SIDE as i32;
        let block = &self.blocks[*self.index.get(&at.map(|i| i.div_euclid(side)))?];
        let [x, y, z] = at.map(|i| i.rem_euclid(side) as usize);
        Some(&block.voxels[(z * SIDE + y) * SIDE + x]).filter(|voxel| voxel.weight > 0.0)
    }

    /// Adds a view.
    pub(super) fn integrate(&mut self, view: &DepthView) -> Result<(), Full> {
        self.allocate_blocks(view)?;
        let (voxel, truncation) = (self.voxel, self.truncation_metres());
        self.blocks.par_iter_mut().for_each(|block| integrate(block, view, voxel, truncation));
        Ok(())
    }

    /// Allocates blocks along the ray of each pixel, from in front of the surface to behind it.
    fn allocate_blocks(&mut self, view: &DepthView) -> Result<(), Full> {
        let truncation = self.truncation_metres();
        let metres = self.voxel * SIDE as f32;
        let steps = (2.0 * TRUNCATION_VOXELS / RAY_STEP_VOXELS) as usize;
        let width = view.camera.width as usize;
        let mut last = None;
        for (pixel, &depth) in view.depth.iter().enumerate().filter(|(_, depth)| **depth > 0.0) {
            let (u, v) = ((pixel % width) as f32, (pixel / width) as f32);
            for step in 0..=steps {
                let z = depth - truncation + step as f32 * RAY_STEP_VOXELS * self.voxel;
                let point = view.camera.unproject(u, v, z);
                let at = [0, 1, 2].map(|axis| (point[axis] / metres).floor() as i32);
                if z <= 0.0 || last == Some(at) {
                    continue;
                }
                last = Some(at);
                if self.index.contains_key(&at) {
                    continue;
                }
                if self.blocks.len() >= self.limit_blocks {
                    return Err(Full);
                }
                self.index.insert(at, self.blocks.len());
                self.blocks.push(Block { at, voxels: vec![Voxel::default(); BLOCK] });
            }
        }
        Ok(())
    }
}

/// Position of a voxel, metres.
pub(super) fn voxel_position(at: [i32; 3], voxel: f32) -> Point3<f32> {
    Point3::from(at.map(|i| i as f32 * voxel))
}

fn integrate(block: &mut Block, view: &DepthView, voxel: f32, truncation: f32) {
    let camera = &view.camera;
    let corner = block.at.map(|i| i * SIDE as i32);
    let middle = voxel_position(corner.map(|i| i + SIDE as i32 / 2), voxel);
    // Skip the block if the projection of its bounding sphere is outside the image.
    let radius = voxel * SIDE as f32 * 0.87;
    let center = camera.camera_from_world * middle;
    if center.z < -radius {
        return;
    }
    let reach = |focal: f32| focal * radius / (center.z - radius).max(voxel) + 1.0;
    if center.z > radius {
        let (u, v) = (
            camera.fx * center.x / center.z + camera.cx,
            camera.fy * center.y / center.z + camera.cy,
        );
        let out = |at: f32, side: u32, reach: f32| at < -reach || at > side as f32 + reach;
        if out(u, camera.width, reach(camera.fx)) || out(v, camera.height, reach(camera.fy)) {
            return;
        }
    }
    // Along x the coordinates in the camera's frame change by a constant step.
    let step = camera.camera_from_world.rotation * nalgebra::Vector3::x() * voxel;
    for (row, voxels) in block.voxels.chunks_exact_mut(SIDE).enumerate() {
        let offset = [0, (row % SIDE) as i32, (row / SIDE) as i32];
        let start = std::array::from_fn(|axis| corner[axis] + offset[axis]);
        let mut point = camera.camera_from_world * voxel_position(start, voxel);
        for voxel in voxels {
            update(voxel, view, &point, truncation);
            point += step;
        }
    }
}

/// Adds the distance and color of a view to a voxel; `point` is its position in the camera's frame.
fn update(voxel: &mut Voxel, view: &DepthView, point: &Point3<f32>, truncation: f32) {
    let Some(pixel) = view.pixel(point) else { return };
    let measured = view.depth[pixel];
    let distance = measured - point.z;
    if !(measured > 0.0 && distance >= -truncation) {
        return;
    }
    voxel.weight += 1.0;
    voxel.distance += ((distance / truncation).min(1.0) - voxel.distance) / voxel.weight;
    if distance < truncation {
        voxel.colored += 1.0;
        for (mean, value) in voxel.rgb.iter_mut().zip(&view.rgb[pixel * 3..]) {
            *mean += (value - *mean) / voxel.colored;
        }
    }
}
