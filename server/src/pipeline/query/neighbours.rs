//! Which Gaussians are neighbours, and which hang together.
//!
//! In: relevant Gaussians, and how far apart neighbours are. Out: neighbours, cores, groups.

use super::clusters::Weighted;
use nalgebra::Point3;
use rayon::prelude::*;
use rustc_hash::FxHashMap as HashMap;

/// Neighbours of a core, itself among them.
pub(super) const NEIGHBOURS: usize = 3;
/// Reaches up to this are of level 0, metres; each level holds twice as far ones.
const LEAST_REACH: f32 = 0.02;

/// Who is near whom (Gunawan's grid for DBSCAN, 2013): first into blocks so small that all within one
/// are neighbours, so that a dense thing costs as much as its blocks and not as its pairs; then blocks
/// into a grid.
pub(super) struct Neighbours<'a> {
    relevant: &'a [Weighted],
    metres: f32,
    blocks: Vec<Block>,
    /// The block of each.
    block_of: Vec<u32>,
    /// By level: the furthest reach of a block in it, side of a cell, which blocks are in each cell.
    levels: Vec<(f32, f32, HashMap<Cell, Vec<u32>>)>,
}

/// Gaussians that are all neighbours of each other, and a ball that holds them and their reach.
struct Block {
    members: Vec<usize>,
    center: Point3<f32>,
    reach: f32,
}

impl<'a> Neighbours<'a> {
    pub(super) fn new(relevant: &'a [Weighted], metres: f32) -> Self {
        let blocks = blocks(relevant, metres);
        let mut block_of = vec![0; relevant.len()];
        let mut levels: Vec<(f32, f32, HashMap<Cell, Vec<u32>>)> = Vec::new();
        for (block, at) in blocks.iter().zip(0u32..) {
            block.members.iter().for_each(|&member| block_of[member] = at);
            let level = level(block.reach);
            while levels.len() <= level {
                let most = furthest(levels.len());
                levels.push((most, metres + 2.0 * most, HashMap::default()));
            }
            let (_, side, cells) = &mut levels[level];
            cells.entry(cell_of(&block.center, *side)).or_default().push(at);
        }
        levels.retain(|(_, _, cells)| !cells.is_empty());
        Self { relevant, metres, blocks, block_of, levels }
    }

    /// What lies between the balls of two, metres; negative where they overlap.
    pub(super) fn gap(&self, a: usize, b: usize) -> f32 {
        let (a, b) = (&self.relevant[a], &self.relevant[b]);
        (a.point.position - b.point.position).norm() - a.reach - b.reach
    }

    fn are_near(&self, a: usize, b: usize) -> bool {
        a == b || self.gap(a, b) < self.metres
    }

    /// The blocks that may hold neighbours of a block's members, itself among them.
    fn blocks_near(&self, block: &Block) -> impl Iterator<Item = u32> {
        let far = move |reach: f32| self.metres + block.reach + reach;
        self.levels
            .iter()
            .flat_map(move |(most, side, cells)| {
                let (center, steps) = (cell_of(&block.center, *side), (far(*most) / side).ceil());
                around(center, steps as i32).filter_map(|cell| cells.get(&cell)).flatten().copied()
            })
            .filter(move |&other| {
                let other = &self.blocks[other as usize];
                (block.center - other.center).norm_squared() < far(other.reach).powi(2)
            })
    }

    /// The neighbours of one, itself among them.
    pub(super) fn of(&self, at: usize) -> impl Iterator<Item = usize> {
        self.blocks_near(&self.blocks[self.block_of[at] as usize])
            .flat_map(|block| self.blocks[block as usize].members.iter().copied())
            .filter(move |&other| self.are_near(at, other))
    }

    /// Who is at the core of something.
    pub(super) fn cores(&self) -> Vec<bool> {
        let is_core = |(at, &block): (usize, &u32)| {
            self.blocks[block as usize].members.len() >= NEIGHBOURS
                || self.of(at).take(NEIGHBOURS).count() == NEIGHBOURS
        };
        self.block_of.par_iter().enumerate().map(is_core).collect()
    }

    /// Cores that are neighbours, or neighbours of neighbours and so on, in one group.
    pub(super) fn joined(&self, is_core: &[bool]) -> Groups {
        let cores = |block: u32| {
            self.blocks[block as usize].members.iter().copied().filter(|&at| is_core[at])
        };
        let all = 0..self.blocks.len() as u32;
        let mut groups = Groups::new(self.relevant.len());
        for block in all.clone() {
            let Some(first) = cores(block).next() else { continue };
            cores(block).for_each(|other| groups.join(first, other));
        }
        for block in all {
            let Some(first) = cores(block).next() else { continue };
            let near = self.blocks_near(&self.blocks[block as usize]);
            for other in near.filter(|&other| other < block) {
                let Some(second) = cores(other).next() else { continue };
                if groups.of(first) == groups.of(second) {
                    continue;
                }
                if cores(block).any(|a| cores(other).any(|b| self.are_near(a, b))) {
                    groups.join(first, second);
                }
            }
        }
        groups
    }
}

/// All of them in blocks: the reaches of a block are of one level.
fn blocks(relevant: &[Weighted], metres: f32) -> Vec<Block> {
    let mut place_of: HashMap<(usize, Cell), usize> = HashMap::default();
    let mut members: Vec<Vec<usize>> = Vec::new();
    for (at, one) in relevant.iter().enumerate() {
        let level = level(one.reach);
        let least = if level == 0 { 0.0 } else { furthest(level - 1) };
        // Its diagonal is a little less than what neighbours can be apart.
        let side = 0.57 * (metres + 2.0 * least);
        let place =
            *place_of.entry((level, cell_of(&one.point.position, side))).or_insert_with(|| {
                members.push(Vec::new());
                members.len() - 1
            });
        members[place].push(at);
    }
    members.into_iter().map(|members| block(relevant, members)).collect()
}

fn block(relevant: &[Weighted], members: Vec<usize>) -> Block {
    let positions = || members.iter().map(|&at| relevant[at].point.position);
    let low = positions().fold(Point3::from([f32::INFINITY; 3]), |a, b| a.inf(&b));
    let high = positions().fold(Point3::from([f32::NEG_INFINITY; 3]), |a, b| a.sup(&b));
    let center = nalgebra::center(&low, &high);
    let end = |&at: &usize| (relevant[at].point.position - center).norm() + relevant[at].reach;
    let reach = members.iter().map(end).fold(0.0, f32::max);
    Block { members, center, reach }
}

type Cell = [i32; 3];

/// Each level reaches twice as far as the one before.
fn level(reach: f32) -> usize {
    (reach / LEAST_REACH).max(1.0).log2().ceil() as usize
}

/// The furthest reach of a level, metres.
fn furthest(level: usize) -> f32 {
    LEAST_REACH * (1 << level) as f32
}

fn cell_of(position: &Point3<f32>, side: f32) -> Cell {
    std::array::from_fn(|axis| (position[axis] / side).floor() as i32)
}

/// A cell and those up to so many steps from it.
fn around(center: Cell, steps: i32) -> impl Iterator<Item = Cell> {
    let width = 2 * steps + 1;
    (0..width * width * width).map(move |i| {
        let step = [i % width, i / width % width, i / width / width];
        std::array::from_fn(|axis| center[axis].saturating_add(step[axis] - steps))
    })
}

/// Disjoint sets.
pub(super) struct Groups(Vec<usize>);

impl Groups {
    fn new(count: usize) -> Self {
        Self((0..count).collect())
    }

    /// The one that stands for its set.
    pub(super) fn of(&mut self, mut at: usize) -> usize {
        while self.0[at] != at {
            self.0[at] = self.0[self.0[at]];
            at = self.0[at];
        }
        at
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.of(a), self.of(b));
        self.0[a.max(b)] = a.min(b);
    }
}
