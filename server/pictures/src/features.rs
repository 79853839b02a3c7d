//! Features: corners of an image with 3D positions and binary descriptors, and matches between two images.
//!
//! In: a picture. Out: [`Features`], and the indices of pairs that look alike. They tell where a
//! camera is when nothing else does: after a large motion, after a pause, in another exposure.
//!
//! A descriptor compares the brightness of 256 pairs of points around the corner (BRIEF, Calonder 2010). Its
//! size follows from the measured depth, so that it covers the same part of the surface from near and from
//! far, without an image pyramid. Comparisons do not change with exposure. The camera must be held about
//! equally upright: 20 degrees of roll are tolerated.

use crate::corners;
use crate::descriptor::{self, Descriptor};
use crate::grey::Grey;
use crate::picture::Picture;
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
pub struct Features {
    /// Positions in the camera's coordinates, metres.
    points: Vec<Point3<f64>>,
    descriptors: Vec<Descriptor>,
}

impl Features {
    /// Finds corners that have a depth.
    pub fn detect(image: &Picture<'_>) -> Self {
        let grey = Grey::new(image);
        let smooth = grey.smoothed();
        let ([fx, fy], [cx, cy]) = (image.focal, image.centre);
        let mut found = Self::default();
        for [column, row] in corners::find(&grey) {
            let Some(depth) = corners::depth(image, column, row) else { continue };
            let radius = descriptor::radius(fx, depth);
            let x = (column as f32 - cx) / fx;
            let y = (row as f32 - cy) / fy;
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
        let mut forth = vec![Best::default(); self.descriptors.len()];
        let mut back = vec![Best::default(); other.descriptors.len()];
        for (own, (one, best)) in self.descriptors.iter().zip(&mut forth).enumerate() {
            for (at, (candidate, back)) in other.descriptors.iter().zip(&mut back).enumerate() {
                let bits = one.distance(candidate);
                best.add(at, bits);
                back.add(own, bits);
            }
        }
        let found = forth.iter().enumerate().filter_map(|(own, best)| Some((own, best.clear()?)));
        found.filter(|(own, at)| back[*at].clear() == Some(*own)).collect()
    }

    /// How much two pictures look alike: the number of the most distinct corners that have a match.
    pub fn similarity(&self, other: &Self) -> usize {
        let has_match = |one: &&Descriptor| {
            let mut best = Best::default();
            let candidates = other.descriptors.iter().enumerate();
            candidates.for_each(|(at, candidate)| best.add(at, one.distance(candidate)));
            best.clear().is_some()
        };
        self.descriptors.iter().take(QUICK).filter(has_match).count()
    }
}

/// The most and the second most alike of the candidates so far.
#[derive(Clone, Copy)]
struct Best {
    /// Bits that differ.
    bits: u32,
    second: u32,
    at: usize,
}

impl Default for Best {
    fn default() -> Self {
        Self { bits: u32::MAX, second: u32::MAX, at: 0 }
    }
}

impl Best {
    fn add(&mut self, at: usize, bits: u32) {
        if bits < self.bits {
            *self = Self { bits, second: self.bits, at };
        } else {
            self.second = self.second.min(bits);
        }
    }

    /// The best candidate, if it is clearly more alike than all others.
    fn clear(&self) -> Option<usize> {
        let is_clear = self.bits <= MAX_BITS && (self.bits as f32) < UNIQUE * self.second as f32;
        is_clear.then_some(self.at)
    }
}
