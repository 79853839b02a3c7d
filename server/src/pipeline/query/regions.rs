//! From a relevancy image to what a robot can use: mask, boxes, peak.

use super::answer::{Mask, Peak, ScoredBox};
use super::relevancy::Plane;

/// Regions smaller than this share of the image are noise.
const LEAST_SHARE: f32 = 1e-4;
/// Regions of fewer pixels than this are noise in any image.
const LEAST_PIXELS: usize = 4;
/// The most boxes in one answer.
const MAX_BOXES: usize = 256;

/// Pixels of the smallest region that is no noise.
pub(super) fn least_pixels(relevancy: &Plane) -> usize {
    ((relevancy.values.len() as f32 * LEAST_SHARE) as usize).max(LEAST_PIXELS)
}

/// Pixels above the threshold as COCO run lengths: column-major, zeros first.
pub(super) fn mask(relevancy: &Plane, threshold: f32) -> Mask {
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

/// The most relevant pixel; the first in reading order among equals.
pub(super) fn peak(relevancy: &Plane) -> Option<Peak> {
    let better = |best: (usize, f32), (at, &value): (usize, &f32)| {
        if value > best.1 { (at, value) } else { best }
    };
    let first = *relevancy.values.first()?;
    let (at, score) = relevancy.values.iter().enumerate().fold((0, first), better);
    Some(Peak { x: (at % relevancy.width) as f32, y: (at / relevancy.width) as f32, score })
}

/// One box for each region of pixels above the threshold that touch by side or corner, best first.
pub(super) fn boxes(relevancy: &Plane, threshold: f32) -> Vec<ScoredBox> {
    let pixels = relevancy.values.len();
    let least = least_pixels(relevancy);
    let mut waiting: Vec<bool> = relevancy.values.iter().map(|&v| v > threshold).collect();
    let mut regions = Vec::new();
    for start in 0..pixels {
        if waiting[start] {
            let region = flood(relevancy, &mut waiting, start);
            if region.pixels >= least {
                regions.push(region);
            }
        }
    }
    // The sort is stable: equals stay in reading order.
    regions.sort_by(|a, b| b.score.total_cmp(&a.score).then(b.pixels.cmp(&a.pixels)));
    regions.truncate(MAX_BOXES);
    regions.iter().map(Region::scored_box).collect()
}

struct Region {
    pixels: usize,
    score: f32,
    columns: [usize; 2],
    rows: [usize; 2],
}

impl Region {
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

/// The region around `start`; its pixels do not wait any more.
fn flood(relevancy: &Plane, waiting: &mut [bool], start: usize) -> Region {
    let (width, height) = (relevancy.width, relevancy.height);
    let mut region = Region {
        pixels: 0,
        score: f32::NEG_INFINITY,
        columns: [usize::MAX, 0],
        rows: [usize::MAX, 0],
    };
    let mut stack = vec![start];
    waiting[start] = false;
    while let Some(at) = stack.pop() {
        let (row, column) = (at / width, at % width);
        region.pixels += 1;
        region.score = region.score.max(relevancy.values[at]);
        region.columns = [region.columns[0].min(column), region.columns[1].max(column)];
        region.rows = [region.rows[0].min(row), region.rows[1].max(row)];
        for row in row.saturating_sub(1)..(row + 2).min(height) {
            for column in column.saturating_sub(1)..(column + 2).min(width) {
                let neighbour = row * width + column;
                if std::mem::take(&mut waiting[neighbour]) {
                    stack.push(neighbour);
                }
            }
        }
    }
    region
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(rows: &[&str]) -> Plane {
        let values = rows.concat().bytes().map(|b| f32::from(b - b'0') / 10.0).collect();
        Plane { width: rows[0].len(), height: rows.len(), values }
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
        let image = plane(&["0990", "0900", "0097"]);
        let packed = mask(&image, 0.5);
        let expected: Vec<bool> = image.values.iter().map(|&v| v > 0.5).collect();
        assert_eq!(unpacked(&packed), expected);
        // Column-major, zeros first: by hand.
        assert_eq!(packed.counts, [3, 2, 1, 1, 1, 1, 2, 1]);
        // Negative control: another threshold is another mask.
        assert_ne!(mask(&image, 0.8), packed);
        // Starting with a one: no zeros first. Nothing and everything.
        assert_eq!(mask(&plane(&["90"]), 0.5).counts, [0, 1, 1]);
        assert_eq!(mask(&plane(&["00"]), 0.5).counts, [2]);
        assert_eq!(mask(&plane(&["99"]), 0.5).counts, [0, 2]);
    }

    #[test]
    fn regions_touch_by_corners_and_small_ones_are_noise() {
        let image = plane(&[
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
        // The lone 6 counts in the mask and not among the boxes.
        assert!(unpacked(&mask(&image, 0.5))[17]);
        // Negative control: apart by a column they are two, and too small.
        assert_eq!(boxes(&plane(&["770770"]), 0.5), []);
    }

    #[test]
    fn the_peak_is_the_first_of_the_greatest() {
        let found = peak(&plane(&["012", "922", "009"])).unwrap();
        assert_eq!(found, Peak { x: 0.0, y: 1.0, score: 0.9 });
        assert_eq!(peak(&Plane { width: 0, height: 0, values: vec![] }), None);
    }
}
