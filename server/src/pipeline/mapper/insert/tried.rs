//! Where the map has had its chances.
//!
//! In: the pictures of the keyframes so far. Out: whether a point was shown by many of them, from as near.
//! New Gaussians at each visit pile up, most of them at edges, and pictures got 3 dB worse after four
//! visits (`BENCHMARKS.md`).

use super::super::super::working::Working;
use nalgebra::{Isometry3, Point3};

/// From as near: from at most so many times the distance.
const AS_NEAR: f32 = 1.5;

/// The keyframes so far.
pub(super) struct Tried<'a> {
    /// Their pictures.
    pub pictures: Vec<&'a Working>,
    /// So many are many.
    pub enough: usize,
}

impl Tried<'_> {
    /// Whether enough of them show the point that `working` shows at this pixel.
    pub fn often(&self, working: &Working, pixel: usize) -> bool {
        if self.pictures.len() < self.enough {
            return false;
        }
        let width = working.camera.width as usize;
        let depth = working.depth_metres[pixel];
        let point = working.camera.unproject((pixel % width) as f32, (pixel / width) as f32, depth);
        let is_near =
            |seen: &&&Working| distance(&seen.camera.camera_from_world, &point) <= AS_NEAR * depth;
        let shown = self.pictures.iter().filter(is_near).filter(|seen| seen.shows(&point));
        shown.take(self.enough).count() == self.enough
    }
}

/// Along the line of sight, metres.
fn distance(camera_from_world: &Isometry3<f32>, point: &Point3<f32>) -> f32 {
    (camera_from_world * point).z
}

#[cfg(test)]
mod tests {
    use super::super::tests::working;
    use super::*;

    /// The wall from farther away.
    fn from(metres: f32) -> Working {
        let mut wall = working(8);
        wall.camera.camera_from_world = Isometry3::translation(0.0, 0.0, metres);
        wall.depth_metres = vec![2.0 + metres; 64].into();
        wall
    }

    #[test]
    fn a_place_has_had_its_chances_when_enough_showed_it_from_as_near() {
        let (wall, near, far) = (working(8), from(0.5), from(4.0));
        let aside = {
            let mut wall = working(8);
            wall.camera.camera_from_world = Isometry3::translation(9.0, 0.0, 0.0);
            wall
        };
        let often = |pictures: &[&Working]| {
            Tried { pictures: pictures.to_vec(), enough: 2 }.often(&wall, 27)
        };
        assert!(often(&[&wall, &near]));
        assert!(!often(&[&wall]), "once is not enough");
        assert!(!often(&[&wall, &aside]), "nor is another place");
        assert!(!often(&[&wall, &far]), "nor is a glance from afar");
        assert!(often(&[&far, &aside, &near, &wall]));
    }
}
