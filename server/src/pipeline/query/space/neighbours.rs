//! Neighbour search for the clustering (Gunawan's grid for DBSCAN, 2013).
//!
//! In: Gaussians and eps. Out: neighbours, core points, connected components of core points.
//!
//! Gaussians are grouped into blocks so small that all Gaussians of a block are neighbours. The
//! cost of dense regions then depends on the number of blocks and not on the number of pairs.
//! Blocks are stored in one grid for each level of radius.

use super::gaussian::RelevantGaussian;
use crate::pipeline::query::disjoint_sets::DisjointSets;
use nalgebra::Point3;
use rayon::prelude::*;
use rustc_hash::FxHashMap as HashMap;

/// Neighbours that make a Gaussian a core point, itself included (minPts of DBSCAN).
pub(super) const MIN_NEIGHBOURS: usize = 3;
/// Largest radius of level 0, metres. It doubles with each level.
const LEVEL_0_RADIUS: f32 = 0.02;

/// Gaussians in blocks and grids.
pub(super) struct Neighbours<'a> {
    gaussians: &'a [RelevantGaussian],
    eps_metres: f32,
    blocks: Vec<Block>,
    /// The block of each Gaussian.
    block_of: Vec<u32>,
    /// The grids, by level.
    levels: Vec<Level>,
}

/// A grid of the blocks with radii up to a limit.
struct Level {
    /// Largest radius of its blocks, metres.
    max_radius: f32,
    /// Side of a cell, metres.
    side: f32,
    /// Indices of the blocks in each cell.
    cells: HashMap<Cell, Vec<u32>>,
}

/// Gaussians that are all neighbours of each other, with a bounding ball of their balls.
struct Block {
    members: Vec<usize>,
    center: Point3<f32>,
    radius: f32,
}

impl<'a> Neighbours<'a> {
    pub(super) fn new(gaussians: &'a [RelevantGaussian], eps_metres: f32) -> Self {
        let blocks = blocks(gaussians, eps_metres);
        let mut block_of = vec![0; gaussians.len()];
        let mut levels: Vec<Level> = Vec::new();
        for (block, at) in blocks.iter().zip(0u32..) {
            block.members.iter().for_each(|&member| block_of[member] = at);
            let level = level(block.radius);
            while levels.len() <= level {
                let max_radius = max_radius(levels.len());
                let side = eps_metres + 2.0 * max_radius;
                levels.push(Level { max_radius, side, cells: HashMap::default() });
            }
            let Level { side, cells, .. } = &mut levels[level];
            cells.entry(cell_of(&block.center, *side)).or_default().push(at);
        }
        levels.retain(|level| !level.cells.is_empty());
        Self { gaussians, eps_metres, blocks, block_of, levels }
    }

    /// Gap between the balls of two Gaussians, metres; negative where they overlap.
    pub(super) fn gap(&self, a: usize, b: usize) -> f32 {
        let (a, b) = (&self.gaussians[a], &self.gaussians[b]);
        (a.point.position - b.point.position).norm() - a.radius - b.radius
    }

    fn are_near(&self, a: usize, b: usize) -> bool {
        a == b || self.gap(a, b) < self.eps_metres
    }

    /// The blocks that may contain neighbours of a block's members, including the block itself.
    fn blocks_near(&self, block: &Block) -> impl Iterator<Item = u32> {
        let distance = move |radius: f32| self.eps_metres + block.radius + radius;
        self.levels
            .iter()
            .flat_map(move |level| {
                let steps = (distance(level.max_radius) / level.side).ceil() as i32;
                cells_around(cell_of(&block.center, level.side), steps)
                    .filter_map(|cell| level.cells.get(&cell))
                    .flatten()
                    .copied()
            })
            .filter(move |&other| {
                let other = &self.blocks[other as usize];
                (block.center - other.center).norm_squared() < distance(other.radius).powi(2)
            })
    }

    /// The neighbours of a Gaussian, including itself.
    pub(super) fn of(&self, at: usize) -> impl Iterator<Item = usize> {
        self.blocks_near(&self.blocks[self.block_of[at] as usize])
            .flat_map(|block| self.blocks[block as usize].members.iter().copied())
            .filter(move |&other| self.are_near(at, other))
    }

    /// All pairs of neighbours, each once.
    pub(super) fn pairs(&self) -> Vec<[u32; 2]> {
        let of_block = |at: u32| {
            let block = &self.blocks[at as usize];
            let others = self.blocks_near(block).filter(move |&other| other <= at);
            others.flat_map(move |other| {
                let is_same = other == at;
                let pairs = block.members.iter().flat_map(move |&a| {
                    self.blocks[other as usize].members.iter().map(move |&b| (a, b))
                });
                pairs.filter(move |&(a, b)| (!is_same || a < b) && self.are_near(a, b))
            })
        };
        let pairs = (0..self.blocks.len() as u32).into_par_iter().flat_map_iter(of_block);
        pairs.map(|(a, b)| [a.min(b) as u32, a.max(b) as u32]).collect()
    }

    /// For each Gaussian whether it is a core point.
    pub(super) fn core_points(&self) -> Vec<bool> {
        let is_core = |(at, &block): (usize, &u32)| {
            self.blocks[block as usize].members.len() >= MIN_NEIGHBOURS
                || self.of(at).take(MIN_NEIGHBOURS).count() == MIN_NEIGHBOURS
        };
        self.block_of.par_iter().enumerate().map(is_core).collect()
    }

    /// Connected components of the core points marked in `is_core`.
    pub(super) fn core_components(&self, is_core: &[bool]) -> DisjointSets {
        let cores = |block: u32| {
            self.blocks[block as usize].members.iter().copied().filter(|&at| is_core[at])
        };
        let all = 0..self.blocks.len() as u32;
        let mut components = DisjointSets::new(self.gaussians.len());
        for block in all.clone() {
            let Some(first) = cores(block).next() else { continue };
            cores(block).for_each(|other| components.join(first, other));
        }
        for block in all {
            let Some(first) = cores(block).next() else { continue };
            let near = self.blocks_near(&self.blocks[block as usize]);
            for other in near.filter(|&other| other < block) {
                let Some(second) = cores(other).next() else { continue };
                if components.representative(first) == components.representative(second) {
                    continue;
                }
                if cores(block).any(|a| cores(other).any(|b| self.are_near(a, b))) {
                    components.join(first, second);
                }
            }
        }
        components
    }
}

/// Groups all Gaussians into blocks. The radii of a block are of one level.
fn blocks(gaussians: &[RelevantGaussian], eps_metres: f32) -> Vec<Block> {
    let mut block_of_cell: HashMap<(usize, Cell), usize> = HashMap::default();
    let mut members: Vec<Vec<usize>> = Vec::new();
    for (at, gaussian) in gaussians.iter().enumerate() {
        let level = level(gaussian.radius);
        let min_radius = if level == 0 { 0.0 } else { max_radius(level - 1) };
        // The diagonal of a cell is a little less than the distance of neighbours.
        let side = 0.57 * (eps_metres + 2.0 * min_radius);
        let block = *block_of_cell
            .entry((level, cell_of(&gaussian.point.position, side)))
            .or_insert_with(|| {
                members.push(Vec::new());
                members.len() - 1
            });
        members[block].push(at);
    }
    members.into_iter().map(|members| block(gaussians, members)).collect()
}

fn block(gaussians: &[RelevantGaussian], members: Vec<usize>) -> Block {
    let positions = || members.iter().map(|&at| gaussians[at].point.position);
    let low = positions().fold(Point3::from([f32::INFINITY; 3]), |a, b| a.inf(&b));
    let high = positions().fold(Point3::from([f32::NEG_INFINITY; 3]), |a, b| a.sup(&b));
    let center = nalgebra::center(&low, &high);
    let end = |&at: &usize| (gaussians[at].point.position - center).norm() + gaussians[at].radius;
    let radius = members.iter().map(end).fold(0.0, f32::max);
    Block { members, center, radius }
}

type Cell = [i32; 3];

/// The level of a radius.
fn level(radius: f32) -> usize {
    (radius / LEVEL_0_RADIUS).max(1.0).log2().ceil() as usize
}

/// Largest radius of a level, metres.
fn max_radius(level: usize) -> f32 {
    LEVEL_0_RADIUS * (1 << level) as f32
}

fn cell_of(position: &Point3<f32>, side: f32) -> Cell {
    std::array::from_fn(|axis| (position[axis] / side).floor() as i32)
}

/// A cell and the cells up to `steps` from it along each axis.
fn cells_around(center: Cell, steps: i32) -> impl Iterator<Item = Cell> {
    let width = 2 * steps + 1;
    (0..width * width * width).map(move |i| {
        let step = [i % width, i / width % width, i / width / width];
        std::array::from_fn(|axis| center[axis].saturating_add(step[axis] - steps))
    })
}
