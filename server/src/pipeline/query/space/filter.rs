//! Spatial filter of objects: within a box, and sorted by the distance to a point.
//!
//! The distance is the one from the point to the oriented box of the object, metres; 0 inside. An
//! object is within the box if its centre is: objects cut off at the box would have wrong sizes.

use crate::pipeline::query::answer::Object;
use crate::pipeline::query::request::SpatialFilter;
use nalgebra::Point3;

/// Keeps the objects within the box, and sorts them by distance if there is a point.
pub(super) fn apply(objects: &mut Vec<Object>, filter: &SpatialFilter) {
    if let Some(within) = filter.within {
        objects.retain(|object| within.contains(&object.center));
    }
    if let Some(near) = filter.near {
        for object in objects.iter_mut() {
            object.distance = Some(distance(object, &near));
        }
        // The sort is stable: of equally distant objects the better one comes first.
        objects.sort_by(|a, b| a.distance.unwrap_or(0.0).total_cmp(&b.distance.unwrap_or(0.0)));
    }
}

/// Distance from a point to the oriented box of an object, metres.
fn distance(object: &Object, point: &Point3<f32>) -> f32 {
    let in_box = object.rotation.inverse_transform_vector(&(point - object.center));
    let beyond = in_box.abs() - object.size / 2.0;
    beyond.map(|side| side.max(0.0)).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::query::request::Bounds;
    use nalgebra::{UnitQuaternion, Vector3};

    fn object(score: f32, x: f32, rotation: UnitQuaternion<f32>) -> Object {
        let center = Point3::new(x, 0.0, 0.0);
        Object {
            score,
            confidence: score,
            center,
            size: Vector3::new(2.0, 1.0, 1.0),
            rotation,
            aabb_min: center,
            aabb_max: center,
            points: 1,
            distance: None,
        }
    }

    #[test]
    fn objects_are_sorted_by_the_distance_to_their_oriented_boxes() {
        let straight = UnitQuaternion::identity();
        let rotated =
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f32::consts::FRAC_PI_2);
        let mut found = vec![object(0.9, 5.0, straight), object(0.8, -3.0, rotated)];
        let near = Some(Point3::origin());
        apply(&mut found, &SpatialFilter { near, within: None });
        // The rotated object extends half a metre from its centre along x, the other one a metre.
        let distances: Vec<f32> = found.iter().filter_map(|object| object.distance).collect();
        assert!((distances[0] - 2.5).abs() < 1e-5 && (distances[1] - 4.0).abs() < 1e-5);
        assert_eq!(found[0].score, 0.8);
        let inside = object(0.5, 0.3, straight);
        assert_eq!(distance(&inside, &Point3::origin()), 0.0);
        // Negative control: without a point the order is kept and there are no distances.
        let mut found = vec![object(0.9, 5.0, straight), object(0.8, -3.0, rotated)];
        apply(&mut found, &SpatialFilter::default());
        assert!(found[0].score == 0.9 && found[0].distance.is_none());
    }

    #[test]
    fn objects_outside_the_box_are_dropped() {
        let straight = UnitQuaternion::identity();
        let mut found = vec![object(0.9, 5.0, straight), object(0.8, -3.0, straight)];
        let within =
            Some(Bounds { min: Point3::new(-4.0, -1.0, -1.0), max: Point3::new(-3.0, 1.0, 1.0) });
        apply(&mut found, &SpatialFilter { near: None, within });
        assert!(found.len() == 1 && found[0].score == 0.8);
    }
}
