//! Edges of depth and of brightness.

use super::small_frame::SmallFrame;

/// A step to a depth that is larger by this share is an edge of the nearer surface.
const STEP: f32 = 0.08;
/// The change on the near side of an edge is smaller than this share of the step: slanted floors have none.
const FLAT: f32 = 0.25;
/// At most so many edge pixels of a frame are used, evenly chosen.
const MOST: usize = 400;
/// Pixels at the border of a picture that have no edges.
const BORDER: usize = 2;

/// Pixels (column, row) on the near side of edges of depth.
pub(super) fn of_depth(frame: &SmallFrame) -> Vec<[usize; 2]> {
    let (width, height) = frame.size();
    let depth = &frame.depth_metres;
    let is_edge = |at: usize| {
        let here = depth[at];
        // Each neighbour, and the one on the other side.
        let sides = [(at + 1, at - 1), (at - 1, at + 1), (at + width, at - width)];
        here > 0.0
            && sides.into_iter().chain([(at - width, at + width)]).any(|(far, near)| {
                let step = depth[far] - here;
                let change = (depth[near] - here).abs();
                depth[near] > 0.0 && step > STEP * here && change < FLAT * step
            })
    };
    let inner = |size: usize| BORDER..size.saturating_sub(BORDER);
    let pixels = inner(height).flat_map(|row| inner(width).map(move |column| [column, row]));
    let all: Vec<_> = pixels.filter(|[column, row]| is_edge(row * width + column)).collect();
    if all.len() <= MOST {
        return all;
    }
    (0..MOST).map(|at| all[at * all.len() / MOST]).collect()
}

/// `[height * width]`: how strong the strongest change of brightness within a pixel is, as a rank among all
/// pixels: -0.5 to 0.5, with mean 0.
pub(super) fn of_brightness(frame: &SmallFrame) -> Vec<f32> {
    let (width, height) = frame.size();
    let grey = &frame.grey;
    let change = |column: usize, row: usize| {
        if column == 0 || row == 0 || column + 1 >= width || row + 1 >= height {
            return 0.0;
        }
        let at = row * width + column;
        (grey[at + 1] - grey[at - 1]).hypot(grey[at + width] - grey[at - width])
    };
    let changes: Vec<f32> = (0..height * width).map(|at| change(at % width, at / width)).collect();
    let rows = strongest(&changes, width, height, 1, 0);
    ranks(&strongest(&rows, width, height, 0, 1))
}

/// The largest of each value and its neighbours to both sides, in rows or in columns.
fn strongest(values: &[f32], width: usize, height: usize, columns: usize, rows: usize) -> Vec<f32> {
    let largest = |at: usize| {
        let (column, row) = (at % width, at / width);
        let before = row.saturating_sub(rows) * width + column.saturating_sub(columns);
        let after = (row + rows).min(height - 1) * width + (column + columns).min(width - 1);
        values[before].max(values[at]).max(values[after])
    };
    (0..values.len()).map(largest).collect()
}

/// The place of each value among all, -0.5 to 0.5; equal values have one place.
fn ranks(values: &[f32]) -> Vec<f32> {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f32::total_cmp);
    let place = |value: &f32| {
        let below = sorted.partition_point(|other| other < value);
        let upto = sorted.partition_point(|other| other <= value);
        (below + upto) as f32 / (2 * values.len()) as f32 - 0.5
    };
    values.iter().map(place).collect()
}
