//! Where in space objects and points may be: inside a box, or nearest to a point.
//!
//! distance = that of the point to the object's oriented box, metres; 0 inside. Objects are judged whole, by
//! their centres: a box that cut them would give them wrong sizes.

use super::answer::Object;
use super::request::Place;
use nalgebra::Point3;

/// Keeps the objects inside, nearest first if there is a point to be near to.
pub(super) fn sort_out(objects: &mut Vec<Object>, place: &Place) {
    if let Some(within) = place.within {
        objects.retain(|object| within.contains(&object.center));
    }
    if let Some(near) = place.near {
        for object in objects.iter_mut() {
            object.distance = Some(distance(object, &near));
        }
        // Stable: the better of two that are equally near comes first.
        objects.sort_by(|a, b| a.distance.unwrap_or(0.0).total_cmp(&b.distance.unwrap_or(0.0)));
    }
}

/// From a point to an object's oriented box, metres.
fn distance(object: &Object, point: &Point3<f32>) -> f32 {
    let in_box = object.rotation.inverse_transform_vector(&(point - object.center));
    let beyond = in_box.abs() - object.size / 2.0;
    beyond.map(|side| side.max(0.0)).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::query::Bounds;
    use nalgebra::{UnitQuaternion, Vector3};

    fn object(score: f32, x: f32, rotation: UnitQuaternion<f32>) -> Object {
        let center = Point3::new(x, 0.0, 0.0);
        Object {
            score,
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
    fn nearest_first_by_the_turned_box() {
        let straight = UnitQuaternion::identity();
        let turned =
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f32::consts::FRAC_PI_2);
        let mut found = vec![object(0.9, 5.0, straight), object(0.8, -3.0, turned)];
        let near = Some(Point3::origin());
        sort_out(&mut found, &Place { near, within: None });
        // The turned one is half a metre thick along x, the straight one a metre.
        let distances: Vec<f32> = found.iter().filter_map(|object| object.distance).collect();
        assert!((distances[0] - 2.5).abs() < 1e-5 && (distances[1] - 4.0).abs() < 1e-5);
        assert_eq!(found[0].score, 0.8);
        let inside = object(0.5, 0.3, straight);
        assert_eq!(distance(&inside, &Point3::origin()), 0.0);
        // Negative control: without a point the order and the distances stay as they are.
        let mut found = vec![object(0.9, 5.0, straight), object(0.8, -3.0, turned)];
        sort_out(&mut found, &Place::default());
        assert!(found[0].score == 0.9 && found[0].distance.is_none());
    }

    #[test]
    fn what_is_outside_is_left_out() {
        let straight = UnitQuaternion::identity();
        let mut found = vec![object(0.9, 5.0, straight), object(0.8, -3.0, straight)];
        let within =
            Some(Bounds { min: Point3::new(-4.0, -1.0, -1.0), max: Point3::new(-3.0, 1.0, 1.0) });
        sort_out(&mut found, &Place { near: None, within });
        assert!(found.len() == 1 && found[0].score == 0.8);
    }
}
