//! A truncated signed distance field of what keyframes show (Curless and Levoy 1996; KinectFusion).
//!
//! In: depths in metres and colors of a view. Held: blocks of 8x8x8 voxels near surfaces only, within a
//! bound of memory. A voxel's distance is that from its centre to the measured surface along the
//! camera's z, divided by the truncation, averaged with weight one per view, positive in front;
//! what is farther behind than the truncation says nothing.

use super::View;
use nalgebra::Point3;
use rayon::prelude::*;
use std::collections::HashMap;

/// Voxels along an edge of a block.
pub(super) const SIDE: usize = 8;
/// Voxels in a block.
const BLOCK: usize = SIDE * SIDE * SIDE;
/// Truncation in voxels. The paper's code has five; rendered depth is smooth, and four keeps thin
/// things apart better.
const TRUNCATION_VOXELS: f32 = 4.0;
/// Voxels between the places along a ray where blocks are made.
const RAY_STEP_VOXELS: f32 = 2.0;

/// A place of the field.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Voxel {
    /// In truncations, at most 1; positive is free.
    pub distance: f32,
    /// Views that saw it; 0: unknown.
    pub weight: f32,
    /// Mean color of the views that saw it near a surface.
    pub rgb: [f32; 3],
    /// How many those were.
    pub colored: f32,
}

struct Block {
    at: [i32; 3],
    voxels: Vec<Voxel>,
}

/// The field.
pub(super) struct Volume {
    /// Side of a voxel, metres.
    voxel: f32,
    limit_blocks: usize,
    blocks: Vec<Block>,
    index: HashMap<[i32; 3], usize>,
}

/// More blocks than there may be.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Full;

impl Volume {
    /// An empty field that may grow to `limit_bytes`.
    pub(super) fn new(voxel: f32, limit_bytes: usize) -> Self {
        let limit_blocks = limit_bytes / (BLOCK * size_of::<Voxel>());
        Self { voxel, limit_blocks, blocks: Vec::new(), index: HashMap::new() }
    }

    /// Side of a voxel, metres.
    pub(super) fn voxel_metres(&self) -> f32 {
        self.voxel
    }

    /// Metres to either side of a surface that hold distances.
    pub(super) fn truncation_metres(&self) -> f32 {
        self.voxel * TRUNCATION_VOXELS
    }

    /// Where the blocks are, in blocks.
    pub(super) fn blocks(&self) -> impl IndexedParallelIterator<Item = [i32; 3]> + '_ {
        self.blocks.par_iter().map(|block| block.at)
    }

    /// The voxel at a place in voxels; `None` if nothing is known there.
    pub(super) fn voxel(&self, at: [i32; 3]) -> Option<&Voxel> {
        let side = SIDE as i32;
        let block = &self.blocks[*self.index.get(&at.map(|i| i.div_euclid(side)))?];
        let [x, y, z] = at.map(|i| i.rem_euclid(side) as usize);
        Some(&block.voxels[(z * SIDE + y) * SIDE + x]).filter(|voxel| voxel.weight > 0.0)
    }

    /// Adds what a view shows.
    pub(super) fn integrate(&mut self, view: &View) -> Result<(), Full> {
        self.make_blocks(view)?;
        let (voxel, truncation) = (self.voxel, self.truncation_metres());
        self.blocks.par_iter_mut().for_each(|block| integrate(block, view, voxel, truncation));
        Ok(())
    }

    /// Blocks along each pixel's ray, from before to behind the surface.
    fn make_blocks(&mut self, view: &View) -> Result<(), Full> {
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

/// Where a voxel is, metres.
pub(super) fn place(at: [i32; 3], voxel: f32) -> Point3<f32> {
    Point3::from(at.map(|i| i as f32 * voxel))
}

fn integrate(block: &mut Block, view: &View, voxel: f32, truncation: f32) {
    let camera = &view.camera;
    let corner = block.at.map(|i| i * SIDE as i32);
    let middle = place(corner.map(|i| i + SIDE as i32 / 2), voxel);
    // A sphere around the block, seen as an angle: is it in the picture at all?
    let radius = voxel * SIDE as f32 * 0.87;
    let seen = camera.camera_from_world * middle;
    if seen.z < -radius {
        return;
    }
    let reach = |focal: f32| focal * radius / (seen.z - radius).max(voxel) + 1.0;
    if seen.z > radius {
        let (u, v) =
            (camera.fx * seen.x / seen.z + camera.cx, camera.fy * seen.y / seen.z + camera.cy);
        let out = |at: f32, side: u32, reach: f32| at < -reach || at > side as f32 + reach;
        if out(u, camera.width, reach(camera.fx)) || out(v, camera.height, reach(camera.fy)) {
            return;
        }
    }
    // Along x the camera's coordinates grow by a constant.
    let step = camera.camera_from_world.rotation * nalgebra::Vector3::x() * voxel;
    for (row, voxels) in block.voxels.chunks_exact_mut(SIDE).enumerate() {
        let offset = [0, (row % SIDE) as i32, (row / SIDE) as i32];
        let start = std::array::from_fn(|axis| corner[axis] + offset[axis]);
        let mut point = camera.camera_from_world * place(start, voxel);
        for voxel in voxels {
            update(voxel, view, &point, truncation);
            point += step;
        }
    }
}

/// Averages a view's distance and color into a voxel; `point` is in the camera.
fn update(voxel: &mut Voxel, view: &View, point: &Point3<f32>, truncation: f32) {
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
