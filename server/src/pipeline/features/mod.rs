//! Features: corners of an image with 3D positions and binary descriptors, and matches between two images.
//!
//! In: a downsampled frame. Out: [`Features`], and the indices of pairs that look alike. They tell where a
//! camera is when nothing else does: after a large motion, after a pause, in another exposure.
//!
//! A descriptor compares the brightness of 256 pairs of points around the corner (BRIEF, Calonder 2010). Its
//! size follows from the measured depth, so that it covers the same part of the surface from near and from
//! far, without an image pyramid. Comparisons do not change with exposure. The camera must be held about
//! equally upright: 20 degrees of roll are tolerated.

mod corners;
mod descriptor;
mod grey;
#[cfg(test)]
mod tests;

use super::downsampled_frame::DownsampledFrame;
use descriptor::Descriptor;
pub(super) use grey::Grey;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// Descriptors that differ in more of their 256 bits are of different things.
const MAX_BITS: u32 = 64;
/// The best match must differ in fewer bits than this share of the second best.
const UNIQUE: f32 = 0.85;
/// Number of the most distinct corners that a quick comparison looks at.
const QUICK: usize = 96;

/// Corners of one image, the most distinct first.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Features {
    /// Positions in the camera's coordinates, metres.
    points: Vec<Point3<f64>>,
    descriptors: Vec<Descriptor>,
}

impl Features {
    /// Finds corners that have a depth.
    pub fn detect(image: &DownsampledFrame) -> Self {
        let grey = Grey::new(image);
        let smooth = grey.smoothed();
        let camera = &image.camera;
        let mut found = Self::default();
        for [column, row] in corners::find(&grey) {
            let Some(depth) = corners::depth(image, column, row) else { continue };
            let radius = descriptor::radius(camera.fx, depth);
            let x = (column as f32 - camera.cx) / camera.fx;
            let y = (row as f32 - camera.cy) / camera.fy;
            found.points.push(Point3::new(x * depth, y * depth, depth).cast());
            found.descriptors.push(Descriptor::new(&smooth, column, row, radius));
        }
        found
    }

    /// Position of a corner in the camera's coordinates, metres.
    pub fn point(&self, index: usize) -> &Point3<f64> {
        &self.points[index]
    }

    /// Memory, bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.points[..]) + size_of_val(&self.descriptors[..])
    }

    /// Pairs (own index, other's index) that are each other's best match.
    pub fn matches(&self, other: &Self) -> Vec<(usize, usize)> {
        let back: Vec<Option<usize>> =
            other.descriptors.iter().map(|one| best_match(one, &self.descriptors)).collect();
        let forth = self.descriptors.iter().map(|one| best_match(one, &other.descriptors));
        forth
            .enumerate()
            .filter_map(|(own, found)| found.map(|found| (own, found)))
            .filter(|(own, found)| back[*found] == Some(*own))
            .collect()
    }

    /// How much two images look alike: the number of the most distinct corners that have a match.
    pub fn similarity(&self, other: &Self) -> usize {
        let quick = self.descriptors.iter().take(QUICK);
        quick.filter(|one| best_match(one, &other.descriptors).is_some()).count()
    }
}

/// The candidate that is clearly more alike than all others.
fn best_match(one: &Descriptor, candidates: &[Descriptor]) -> Option<usize> {
    let (mut best, mut second, mut at) = (u32::MAX, u32::MAX, 0);
    for (index, candidate) in candidates.iter().enumerate() {
        let bits = one.distance(candidate);
        if bits < best {
            (second, best, at) = (best, bits, index);
        } else {
            second = second.min(bits);
        }
    }
    (best <= MAX_BITS && (best as f32) < UNIQUE * second as f32).then_some(at)
}
