//! Which squares of a picture get a Gaussian: large ones where it is flat, small ones where there is detail.
//!
//! In: a picture with depth, and which of its pixels the map does not explain. Out: squares, each of
//! one color and one surface as far as its size allows. Squares are halved like a quadtree's, so that
//! a wall costs few Gaussians and print many. It must not know the map.

use super::super::super::working::Working;

/// A square of pixels; the ones at the right and lower border may be cut off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cell {
    pub left: usize,
    pub top: usize,
    pub side: usize,
}

/// When a square is left whole.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grain {
    /// Sides of the largest and of the smallest square, pixels; the largest is rounded to the smallest
    /// times a power of two.
    pub max_side: usize,
    pub min_side: usize,
    /// Greatest difference of a channel within a square, 0 to 1.
    pub detail: f32,
    /// Greatest difference of depths within a square, as a share of the nearest.
    pub relief: f32,
}

/// The squares that cover the pixels that are wanted.
pub(super) fn cells(working: &Working, wanted: &[bool], grain: Grain) -> Vec<Cell> {
    let smallest = grain.min_side.max(1);
    let mut largest = smallest;
    while largest * 2 <= grain.max_side {
        largest *= 2;
    }
    let (width, height) = (working.camera.width as usize, working.camera.height as usize);
    let mut found = Vec::new();
    for top in (0..height).step_by(largest) {
        for left in (0..width).step_by(largest) {
            divide(working, wanted, grain, Cell { left, top, side: largest }, &mut found);
        }
    }
    found
}

fn divide(working: &Working, wanted: &[bool], grain: Grain, cell: Cell, found: &mut Vec<Cell>) {
    let measured = cell.pixels(working).filter(|at| working.depth_metres[*at] > 0.0).count();
    let missing = cell.pixels(working).filter(|at| wanted[*at]).count();
    if missing == 0 {
        return;
    }
    let is_smallest = cell.side / 2 < grain.min_side.max(1);
    // A single pixel at the seam of what the map has is no gap.
    let is_wanted = missing * 2 >= measured;
    if is_smallest || (is_wanted && is_even(working, cell, grain)) {
        if is_wanted {
            found.push(cell);
        }
        return;
    }
    let side = cell.side / 2;
    for (right, down) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let quarter = Cell { left: cell.left + right * side, top: cell.top + down * side, side };
        divide(working, wanted, grain, quarter, found);
    }
}

/// Whether one color and one surface fill the square.
fn is_even(working: &Working, cell: Cell, grain: Grain) -> bool {
    let mut color = [[u8::MAX, u8::MIN]; 3];
    let mut depth = [f32::INFINITY, 0.0f32];
    for at in cell.pixels(working) {
        for (channel, [low, high]) in color.iter_mut().enumerate() {
            let value = working.rgb[at * 3 + channel];
            (*low, *high) = ((*low).min(value), (*high).max(value));
        }
        let measured = working.depth_metres[at];
        if measured <= 0.0 {
            return false;
        }
        depth = [depth[0].min(measured), depth[1].max(measured)];
    }
    let range = color.iter().map(|[low, high]| high.saturating_sub(*low)).max().unwrap_or(0);
    f32::from(range) <= grain.detail * 255.0 && depth[1] - depth[0] <= grain.relief * depth[0]
}

impl Cell {
    /// The indices of its pixels that lie in the picture.
    pub fn pixels(self, working: &Working) -> impl Iterator<Item = usize> + use<> {
        let (width, height) = (working.camera.width as usize, working.camera.height as usize);
        let columns = self.left.min(width)..(self.left + self.side).min(width);
        let rows = self.top.min(height)..(self.top + self.side).min(height);
        rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::working;
    use super::*;

    const GRAIN: Grain = Grain { max_side: 4, min_side: 1, detail: 0.1, relief: 0.05 };

    fn sides(working: &Working, wanted: &[bool]) -> Vec<usize> {
        cells(working, wanted, GRAIN).iter().map(|cell| cell.side).collect()
    }

    #[test]
    fn flat_squares_stay_whole_and_detail_divides_them() {
        let flat = working(8);
        assert_eq!(sides(&flat, &[true; 64]), [4; 4]);
        let mut dotted = flat.clone();
        let mut rgb = flat.rgb.to_vec();
        rgb[0] = 255;
        dotted.rgb = rgb.into();
        assert_eq!(sides(&dotted, &[true; 64]), [1, 1, 1, 1, 2, 2, 2, 4, 4, 4]);
        let mut edge = flat;
        let mut depth = edge.depth_metres.to_vec();
        depth[63] = 4.0;
        edge.depth_metres = depth.into();
        assert_eq!(sides(&edge, &[true; 64]), [4, 4, 4, 2, 2, 2, 1, 1, 1, 1], "two surfaces");
    }

    #[test]
    fn squares_cover_what_is_wanted_and_nothing_else() {
        let flat = working(6);
        assert!(cells(&flat, &[false; 36], GRAIN).is_empty());
        let mut wanted = [false; 36];
        wanted[7] = true;
        let found = cells(&flat, &wanted, GRAIN);
        assert_eq!(found, [Cell { left: 1, top: 1, side: 1 }], "one pixel");
        let all = cells(&flat, &[true; 36], GRAIN);
        let mut covered = [0; 36];
        all.iter().flat_map(|cell| cell.pixels(&flat)).for_each(|at| covered[at] += 1);
        assert_eq!(covered, [1; 36], "once each, the cut-off squares at the border too");
    }
}
