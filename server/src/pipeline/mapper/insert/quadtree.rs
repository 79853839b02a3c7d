//! Divides an image into quadtree cells, each of which gets one Gaussian.
//!
//! In: an image with depth, and which of its pixels the map does not explain. Out: square cells, each of one
//! color and one surface as far as the smallest size allows. A flat wall thus costs few Gaussians and a
//! printed page many.

use super::super::super::downsampled_frame::DownsampledFrame;

/// A square of pixels. Cells at the right and lower border may extend beyond the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cell {
    pub left: usize,
    pub top: usize,
    pub side: usize,
}

/// When a cell is divided.
#[derive(Clone, Copy, Debug)]
pub(super) struct Subdivision {
    /// Side of the largest cell, pixels; rounded down to `min_side` times a power of two.
    pub max_side: usize,
    /// Side of the smallest cell, pixels.
    pub min_side: usize,
    /// Largest range of a color channel within a cell, 0 to 1.
    pub max_color_range: f32,
    /// Largest range of depth within a cell, as a share of its nearest depth.
    pub max_depth_range: f32,
}

/// The cells that cover the wanted pixels. `wanted`: `[height * width]`.
pub(super) fn quadtree(image: &DownsampledFrame, wanted: &[bool], rule: Subdivision) -> Vec<Cell> {
    let smallest = rule.min_side.max(1);
    let mut largest = smallest;
    while largest * 2 <= rule.max_side {
        largest *= 2;
    }
    let (width, height) = (image.camera.width as usize, image.camera.height as usize);
    let mut found = Vec::new();
    for top in (0..height).step_by(largest) {
        for left in (0..width).step_by(largest) {
            divide(image, wanted, rule, Cell { left, top, side: largest }, &mut found);
        }
    }
    found
}

fn divide(
    image: &DownsampledFrame,
    wanted: &[bool],
    rule: Subdivision,
    cell: Cell,
    found: &mut Vec<Cell>,
) {
    let measured = cell.pixels(image).filter(|at| image.depth_metres[*at] > 0.0).count();
    let missing = cell.pixels(image).filter(|at| wanted[*at]).count();
    if missing == 0 {
        return;
    }
    let is_smallest = cell.side / 2 < rule.min_side.max(1);
    // Less than half a cell is the seam of an explained area and not a gap.
    let is_wanted = missing * 2 >= measured;
    if is_smallest || (is_wanted && is_even(image, cell, rule)) {
        if is_wanted {
            found.push(cell);
        }
        return;
    }
    let side = cell.side / 2;
    for (right, down) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let quarter = Cell { left: cell.left + right * side, top: cell.top + down * side, side };
        divide(image, wanted, rule, quarter, found);
    }
}

/// Whether a cell shows one color and one surface.
fn is_even(image: &DownsampledFrame, cell: Cell, rule: Subdivision) -> bool {
    let mut color = [[u8::MAX, u8::MIN]; 3];
    let mut depth = [f32::INFINITY, 0.0f32];
    for at in cell.pixels(image) {
        for (channel, [low, high]) in color.iter_mut().enumerate() {
            let value = image.rgb[at * 3 + channel];
            (*low, *high) = ((*low).min(value), (*high).max(value));
        }
        let measured = image.depth_metres[at];
        if measured <= 0.0 {
            return false;
        }
        depth = [depth[0].min(measured), depth[1].max(measured)];
    }
    let range = color.iter().map(|[low, high]| high.saturating_sub(*low)).max().unwrap_or(0);
    f32::from(range) <= rule.max_color_range * 255.0
        && depth[1] - depth[0] <= rule.max_depth_range * depth[0]
}

impl Cell {
    /// Indices of its pixels within the image.
    pub fn pixels(self, image: &DownsampledFrame) -> impl Iterator<Item = usize> + use<> {
        let (width, height) = (image.camera.width as usize, image.camera.height as usize);
        let columns = self.left.min(width)..(self.left + self.side).min(width);
        let rows = self.top.min(height)..(self.top + self.side).min(height);
        rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::wall;
    use super::*;

    const RULE: Subdivision =
        Subdivision { max_side: 4, min_side: 1, max_color_range: 0.1, max_depth_range: 0.05 };

    fn sides(image: &DownsampledFrame, wanted: &[bool]) -> Vec<usize> {
        quadtree(image, wanted, RULE).iter().map(|cell| cell.side).collect()
    }

    #[test]
    fn flat_cells_stay_whole_and_detail_divides_them() {
        let flat = wall(8);
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
    fn cells_cover_the_wanted_pixels_and_nothing_else() {
        let flat = wall(6);
        assert!(quadtree(&flat, &[false; 36], RULE).is_empty());
        let mut wanted = [false; 36];
        wanted[7] = true;
        let found = quadtree(&flat, &wanted, RULE);
        assert_eq!(found, [Cell { left: 1, top: 1, side: 1 }], "one pixel");
        let all = quadtree(&flat, &[true; 36], RULE);
        let mut covered = [0; 36];
        all.iter().flat_map(|cell| cell.pixels(&flat)).for_each(|at| covered[at] += 1);
        assert_eq!(covered, [1; 36], "once each, the cut-off cells at the border too");
    }
}
