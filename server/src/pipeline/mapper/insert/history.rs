//! Limits how often Gaussians are inserted at the same place.
//!
//! In: the keyframes so far. Out: whether many of them already showed a point from as near. Inserting at
//! every visit piles up Gaussians, most of them at edges; after four visits images lost 3 dB
//! (EXPERIMENTS.md).

use super::super::super::downsampled_frame::DownsampledFrame;
use nalgebra::{Isometry3, Point3};

/// A keyframe counts if its distance to the point is at most this factor of the new one's.
const MAX_DISTANCE_FACTOR: f32 = 1.5;

/// The keyframes inserted so far.
pub(super) struct InsertionHistory<'a> {
    pub keyframes: Vec<&'a DownsampledFrame>,
    /// A place that this many keyframes showed gets no more Gaussians.
    pub limit: usize,
}

impl InsertionHistory<'_> {
    /// Whether enough keyframes already showed the point at this pixel of `image`.
    pub fn is_exhausted(&self, image: &DownsampledFrame, pixel: usize) -> bool {
        if self.keyframes.len() < self.limit {
            return false;
        }
        let Some(point) = image.point(pixel) else { return false };
        let depth = image.depth_metres[pixel];
        let is_near = |keyframe: &&&DownsampledFrame| {
            depth_of(&point, &keyframe.camera.camera_from_world) <= MAX_DISTANCE_FACTOR * depth
        };
        let near = self.keyframes.iter().filter(is_near);
        let showing = near.filter(|keyframe| keyframe.shows(&point));
        showing.take(self.limit).count() == self.limit
    }
}

/// Depth of a world point along the camera's z axis, metres.
fn depth_of(point: &Point3<f32>, camera_from_world: &Isometry3<f32>) -> f32 {
    (camera_from_world * point).z
}

#[cfg(test)]
mod tests {
    use super::super::tests::wall;
    use super::*;

    /// The wall seen from `metres` further away.
    fn from(metres: f32) -> DownsampledFrame {
        let mut wall = wall(8);
        wall.camera.camera_from_world = Isometry3::translation(0.0, 0.0, metres);
        wall.depth_metres = vec![2.0 + metres; 64].into();
        wall
    }

    #[test]
    fn a_place_is_exhausted_when_enough_keyframes_showed_it_from_as_near() {
        let (here, near, far) = (wall(8), from(0.5), from(4.0));
        let aside = {
            let mut wall = wall(8);
            wall.camera.camera_from_world = Isometry3::translation(9.0, 0.0, 0.0);
            wall
        };
        let exhausted = |keyframes: &[&DownsampledFrame]| {
            let history = InsertionHistory { keyframes: keyframes.to_vec(), limit: 2 };
            history.is_exhausted(&here, 27)
        };
        assert!(exhausted(&[&here, &near]));
        assert!(!exhausted(&[&here]), "one keyframe is not enough");
        assert!(!exhausted(&[&here, &aside]), "another place does not count");
        assert!(!exhausted(&[&here, &far]), "a keyframe from far away does not count");
        assert!(exhausted(&[&far, &aside, &near, &here]));
    }
}
