//! Mask, peak and boxes of the connected components of a relevancy map.

use crate::pipeline::query::answer::{Mask, Peak, ScoredBox};
use crate::pipeline::query::relevancy::RelevancyMap;

/// Components smaller than this share of the image are noise.
const MIN_SHARE: f32 = 1e-4;
/// Components of fewer pixels than this are noise in any image.
const MIN_PIXELS: usize = 4;
/// The most boxes in one answer.
const MAX_BOXES: usize = 256;

/// Pixels of the smallest component that is not noise.
pub(super) fn min_pixels(relevancy: &RelevancyMap) -> usize {
    ((relevancy.values.len() as f32 * MIN_SHARE) as usize).max(MIN_PIXELS)
}

/// Pixels above the threshold as COCO run lengths: column-major, starting with zeros.
pub(super) fn mask(relevancy: &RelevancyMap, threshold: f32) -> Mask {
    let (width, height) = (relevancy.width, relevancy.height);
    let mut counts = Vec::new();
    let mut inside = false;
    let mut run = 0;
    for column in 0..width {
        for row in 0..height {
            if (relevancy.values[row * width + column] > threshold) != inside {
                counts.push(run);
                run = 0;
                inside = !inside;
            }
            run += 1;
        }
    }
    counts.push(run);
    Mask { height: height as u32, width: width as u32, counts }
}

/// The most relevant pixel, the first one in row-major order among equals.
pub(super) fn peak(relevancy: &RelevancyMap) -> Option<Peak> {
    let better = |best: (usize, f32), (at, &value): (usize, &f32)| {
        if value > best.1 { (at, value) } else { best }
    };
    let first = *relevancy.values.first()?;
    let (at, score) = relevancy.values.iter().enumerate().fold((0, first), better);
    Some(Peak { x: (at % relevancy.width) as f32, y: (at / relevancy.width) as f32, score })
}

/// Boxes of the 8-connected components of pixels above the threshold, best first, without noise.
pub(super) fn boxes(relevancy: &RelevancyMap, threshold: f32) -> Vec<ScoredBox> {
    let pixels = relevancy.values.len();
    let least = min_pixels(relevancy);
    let mut unvisited: Vec<bool> = relevancy.values.iter().map(|&v| v > threshold).collect();
    let mut components = Vec::new();
    for start in 0..pixels {
        if unvisited[start] {
            let component = flood_fill(relevancy, &mut unvisited, start);
            if component.pixels >= least {
                components.push(component);
            }
        }
    }
    // The sort is stable: equals stay in row-major order.
    components.sort_by(|a, b| b.score.total_cmp(&a.score).then(b.pixels.cmp(&a.pixels)));
    components.truncate(MAX_BOXES);
    components.iter().map(Component::scored_box).collect()
}

struct Component {
    pixels: usize,
    score: f32,
    columns: [usize; 2],
    rows: [usize; 2],
}

impl Component {
    fn scored_box(&self) -> ScoredBox {
        ScoredBox {
            x: self.columns[0] as f32,
            y: self.rows[0] as f32,
            width: (self.columns[1] + 1 - self.columns[0]) as f32,
            height: (self.rows[1] + 1 - self.rows[0]) as f32,
            score: self.score,
        }
    }
}

/// The component of `start`; marks its pixels as visited.
fn flood_fill(relevancy: &RelevancyMap, unvisited: &mut [bool], start: usize) -> Component {
    let (width, height) = (relevancy.width, relevancy.height);
    let mut component = Component {
        pixels: 0,
        score: f32::NEG_INFINITY,
        columns: [usize::MAX, 0],
        rows: [usize::MAX, 0],
    };
    let mut stack = vec![start];
    unvisited[start] = false;
    while let Some(at) = stack.pop() {
        let (row, column) = (at / width, at % width);
        component.pixels += 1;
        component.score = component.score.max(relevancy.values[at]);
        component.columns = [component.columns[0].min(column), component.columns[1].max(column)];
        component.rows = [component.rows[0].min(row), component.rows[1].max(row)];
        for row in row.saturating_sub(1)..(row + 2).min(height) {
            for column in column.saturating_sub(1)..(column + 2).min(width) {
                let neighbour = row * width + column;
                if std::mem::take(&mut unvisited[neighbour]) {
                    stack.push(neighbour);
                }
            }
        }
    }
    component
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(rows: &[&str]) -> RelevancyMap {
        let values = rows.concat().bytes().map(|b| f32::from(b - b'0') / 10.0).collect();
        RelevancyMap { width: rows[0].len(), height: rows.len(), values }
    }

    fn unpacked(mask: &Mask) -> Vec<bool> {
        let (width, height) = (mask.width as usize, mask.height as usize);
        let mut pixels = vec![false; width * height];
        let mut at = 0;
        for (i, &count) in mask.counts.iter().enumerate() {
            for _ in 0..count {
                pixels[at % height * width + at / height] = i % 2 == 1;
                at += 1;
            }
        }
        assert_eq!(at, width * height, "the runs cover the image");
        pixels
    }

    #[test]
    fn a_mask_unpacks_to_the_pixels_above_the_threshold() {
        let image = map(&["0990", "0900", "0097"]);
        let packed = mask(&image, 0.5);
        let expected: Vec<bool> = image.values.iter().map(|&v| v > 0.5).collect();
        assert_eq!(unpacked(&packed), expected);
        // Column-major, zeros first: by hand.
        assert_eq!(packed.counts, [3, 2, 1, 1, 1, 1, 2, 1]);
        // Negative control: another threshold gives another mask.
        assert_ne!(mask(&image, 0.8), packed);
        // An image that starts with a one; an empty mask; a full mask.
        assert_eq!(mask(&map(&["90"]), 0.5).counts, [0, 1, 1]);
        assert_eq!(mask(&map(&["00"]), 0.5).counts, [2]);
        assert_eq!(mask(&map(&["99"]), 0.5).counts, [0, 2]);
    }

    #[test]
    fn components_are_connected_by_corners_and_small_ones_are_noise() {
        let image = map(&[
            "770000000", //
            "077000006",
            "000000000",
            "000888000",
            "000890000",
        ]);
        let found = boxes(&image, 0.5);
        let first = ScoredBox { x: 3.0, y: 3.0, width: 3.0, height: 2.0, score: 0.9 };
        let second = ScoredBox { x: 0.0, y: 0.0, width: 3.0, height: 2.0, score: 0.7 };
        assert_eq!(found, [first, second]);
        // The single 6 is in the mask and has no box.
        assert!(unpacked(&mask(&image, 0.5))[17]);
        // Negative control: a column between them makes two components, both too small.
        assert_eq!(boxes(&map(&["770770"]), 0.5), []);
    }

    #[test]
    fn the_peak_is_the_first_of_the_largest() {
        let found = peak(&map(&["012", "922", "009"])).unwrap();
        assert_eq!(found, Peak { x: 0.0, y: 1.0, score: 0.9 });
        assert_eq!(peak(&RelevancyMap { width: 0, height: 0, values: vec![] }), None);
    }
}
