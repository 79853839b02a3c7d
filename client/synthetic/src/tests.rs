//! Rooms depend on the seed only; color, depth, instances and poses of a view agree.

use crate::{Camera, Room, View};

const CAMERA: (u32, u32) = (40, 30);

fn view(room: &Room, index: usize) -> View {
    room.render(&Camera::new(CAMERA.0, CAMERA.1), &room.path(20)[index])
}

#[test]
fn rooms_depend_on_the_seed_only() {
    let (room, again, other) = (Room::new(7), Room::new(7), Room::new(8));
    assert_eq!(room.instances(), again.instances());
    assert_ne!(room.instances(), other.instances());
    assert_eq!(view(&room, 3), view(&again, 3));
    assert_ne!(view(&room, 3), view(&other, 3));
}

/// Depth and instance of every pixel agree with the instance's bounding box in the world.
#[test]
fn depth_poses_and_instances_agree() {
    let room = Room::new(7);
    let camera = Camera::new(CAMERA.0, CAMERA.1);
    let pose = room.path(20)[10];
    let view = view(&room, 10);
    let inside = |shift: f64| {
        let fits = |(i, (depth, id)): (usize, (&f32, &u8))| {
            let (u, v) = ((i as u32 % CAMERA.0) as f64 + shift, (i as u32 / CAMERA.0) as f64);
            let z = f64::from(*depth);
            let ray = [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0];
            let point = pose * nalgebra::Point3::from(ray.map(|r| r * z));
            let Some(instance) = room.instances().get(usize::from(*id).wrapping_sub(1)) else {
                return false;
            };
            let (low, high) = (instance.aabb_min, instance.aabb_max);
            (0..3).all(|k| (low[k] - 1e-3..=high[k] + 1e-3).contains(&point[k]))
        };
        view.depth.iter().zip(&view.instances).enumerate().filter(|x| fits(*x)).count()
    };
    let pixels = view.depth.len();
    assert_eq!(inside(0.0), pixels);
    assert!(inside(8.0) < pixels * 9 / 10, "a wrong camera is told apart");
}
