//! A room with boxes and balls, ray-cast through two cameras of different size and lens that are 5 cm apart.

use super::camera::Optics;
use super::*;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// Share by which depth may be off.
const WITHIN: f64 = 0.01;

/// A ball.
struct Ball {
    centre: Vector3<f64>,
    radius: f64,
}

/// An upright box.
struct Block {
    low: Vector3<f64>,
    high: Vector3<f64>,
}

/// The furniture: a column near the camera, a table, a cabinet, two balls.
fn furniture() -> (Vec<Block>, Vec<Ball>) {
    let block = |low: [f64; 3], high: [f64; 3]| Block { low: low.into(), high: high.into() };
    let ball = |centre: [f64; 3], radius| Ball { centre: centre.into(), radius };
    let blocks = vec![
        block([-0.5, -1.2, 1.4], [-0.35, 1.3, 1.55]),
        block([0.1, 0.4, 1.6], [1.2, 0.5, 2.4]),
        block([-1.6, -0.2, 2.4], [-0.8, 1.3, 3.0]),
    ];
    (blocks, vec![ball([0.5, 0.2, 2.0], 0.2), ball([-0.1, -0.5, 2.6], 0.3)])
}

/// Distance along a ray (camera z = 1) to what it hits first: furniture, or the walls of the room.
fn hit(origin: &Vector3<f64>, ray: &Vector3<f64>) -> f64 {
    let (blocks, balls) = furniture();
    let slab = |low: &Vector3<f64>, high: &Vector3<f64>| {
        let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let (a, b) =
                ((low[axis] - origin[axis]) / ray[axis], (high[axis] - origin[axis]) / ray[axis]);
            (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
        }
        (near, far)
    };
    let room = slab(&Vector3::new(-2.5, -1.2, -1.0), &Vector3::new(2.5, 1.3, 4.0)).1;
    let blocks = blocks.iter().filter_map(|block| {
        let (near, far) = slab(&block.low, &block.high);
        (near > 0.0 && near <= far).then_some(near)
    });
    let balls = balls.iter().filter_map(|ball| {
        let away = origin - ball.centre;
        let (a, b) = (ray.norm_squared(), away.dot(ray));
        let root = b * b - a * (away.norm_squared() - ball.radius * ball.radius);
        (root > 0.0).then(|| (-b - root.sqrt()) / a).filter(|near| *near > 0.0)
    });
    blocks.chain(balls).fold(room, f64::min)
}

/// What a camera sees, its pose in the coordinates of the color camera: `[height * width]`, metres.
fn depth_of(camera: &Camera, color_from_camera: &Isometry3<f64>) -> Vec<f32> {
    let optics = Optics::new(camera);
    let Intrinsics { width, height, .. } = camera.intrinsics;
    let at = |pixel: u32| {
        let ray = optics.ray([f64::from(pixel % width), f64::from(pixel / width)]);
        ray.map_or(0.0, |[x, y]| {
            let along = color_from_camera.rotation * Vector3::new(x, y, 1.0);
            hit(&color_from_camera.translation.vector, &along) as f32
        })
    };
    (0..width * height).map(at).collect()
}

fn color_camera(distortion: Distortion) -> Camera {
    let intrinsics =
        Intrinsics { width: 320, height: 240, fx: 250.0, fy: 252.0, cx: 161.0, cy: 118.0 };
    Camera { intrinsics, distortion }
}

fn depth_camera(distortion: Distortion) -> Camera {
    let intrinsics =
        Intrinsics { width: 256, height: 212, fx: 190.0, fy: 190.0, cx: 126.0, cy: 107.5 };
    Camera { intrinsics, distortion }
}

fn beside() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.01, -0.015, 0.008));
    Isometry3::from_parts(Translation3::new(-0.05, 0.004, -0.003), turn)
}

/// Pictures of one color and the given depth.
fn raw(cameras: &Cameras, depth_metres: Vec<f32>) -> Pictures {
    let Intrinsics { width, height, .. } = cameras.color.intrinsics;
    Pictures {
        intrinsics: cameras.color.intrinsics,
        rgb: vec![90; (width * height * 3) as usize].into(),
        depth_metres: depth_metres.into(),
        labels: None,
    }
}

/// Of the pixels whose surface both cameras see: the share that has depth, and the share of those within 1 %.
struct Score {
    covered: f64,
    right: f64,
}

fn scored(cameras: &Cameras, frame: &Pictures) -> Score {
    let Some(DepthCamera::Own { camera, color_from_depth }) = cameras.depth else {
        panic!("a rig");
    };
    let seen = depth_of(&camera, &color_from_depth);
    let pinhole = Camera { intrinsics: frame.intrinsics, distortion: Distortion::None };
    let truth = depth_of(&pinhole, &Isometry3::identity());
    let (optics, depth_optics) = (Optics::new(&pinhole), Optics::new(&camera));
    let (mut both, mut covered, mut right) = (0, 0, 0);
    for (pixel, (truth, found)) in (0_u32..).zip(truth.iter().zip(&*frame.depth_metres)) {
        let width = frame.intrinsics.width;
        let [x, y] = optics.ray([f64::from(pixel % width), f64::from(pixel / width)]).unwrap();
        let point = color_from_depth
            .inverse_transform_point(&(Vector3::new(x, y, 1.0) * f64::from(*truth)).into());
        let place = depth_optics.pixel([point.x / point.z, point.y / point.z]);
        let Some([column, row]) = place.map(|place| place.map(f64::round)) else { continue };
        let camera = &camera.intrinsics;
        let inside = (0.0..f64::from(camera.width)).contains(&column)
            && (0.0..f64::from(camera.height)).contains(&row);
        if !inside {
            continue;
        }
        let measured = f64::from(seen[row as usize * camera.width as usize + column as usize]);
        if (measured - point.z).abs() > WITHIN * point.z {
            continue;
        }
        both += 1;
        covered += u32::from(*found > 0.0);
        let off = (f64::from(*found) - f64::from(*truth)).abs();
        right += u32::from(*found > 0.0 && off <= WITHIN * f64::from(*truth));
    }
    assert!(both > 30_000, "{both}");
    Score {
        covered: f64::from(covered) / f64::from(both),
        right: f64::from(right) / f64::from(covered),
    }
}

const BROWN: Distortion =
    Distortion::BrownConrady([-0.12, 0.03, 0.0008, -0.0006, 0.002, 0.0, 0.0, 0.0]);
const RATIONAL: Distortion =
    Distortion::BrownConrady([0.5, -0.3, 0.0005, -0.0002, 0.1, 0.25, -0.1, 0.05]);
const FISHEYE: Distortion = Distortion::KannalaBrandt([0.02, -0.005, 0.001, 0.0]);

#[test]
fn depth_of_two_cameras_is_registered() {
    for (color, depth) in [
        (Distortion::None, Distortion::None),
        (BROWN, RATIONAL),
        (FISHEYE, BROWN),
        (RATIONAL, FISHEYE),
    ] {
        let cameras = Cameras {
            color: color_camera(color),
            depth: Some(DepthCamera::Own {
                camera: depth_camera(depth),
                color_from_depth: beside(),
            }),
        };
        let registration = Registration::new(cameras).unwrap();
        let seen = depth_of(&depth_camera(depth), &beside());
        let frame = registration.register(raw(&cameras, seen)).unwrap();
        let score = scored(&cameras, &frame);
        println!("{color:?} {depth:?}: {:.4} {:.4}", score.covered, score.right);
        assert!(score.right >= 0.99, "{color:?} and {depth:?}: {:.4} are right", score.right);
        assert!(score.covered >= 0.99, "{color:?} and {depth:?}: {:.4} covered", score.covered);
    }
}

/// The control: without the 5 cm, or without the lens, the same score is missed.
#[test]
fn a_wrong_place_or_a_wrong_lens_scores_worse() {
    let own = |camera, color_from_depth| Cameras {
        color: color_camera(BROWN),
        depth: Some(DepthCamera::Own { camera, color_from_depth }),
    };
    let truth = own(depth_camera(RATIONAL), beside());
    let seen = depth_of(&depth_camera(RATIONAL), &beside());
    for wrong in [
        own(depth_camera(RATIONAL), Isometry3::identity()),
        own(depth_camera(Distortion::None), beside()),
    ] {
        let frame = Registration::new(wrong).unwrap().register(raw(&wrong, seen.clone())).unwrap();
        let right = scored(&truth, &frame).right;
        assert!(right < 0.985, "{wrong:?}: {right:.4}");
    }
}

#[test]
fn nothing_is_done_to_frames_that_are_registered() {
    let cameras = Cameras { color: color_camera(Distortion::None), depth: None };
    let registration = Registration::new(cameras).unwrap();
    assert_eq!(registration.camera(), cameras.color.intrinsics);
    let depth: Vec<f32> = (0..320 * 240).map(|at| at as f32 * 0.001).collect();
    let frame = registration.register(raw(&cameras, depth.clone())).unwrap();
    assert_eq!(frame.depth_metres[..], depth[..]);
}

/// A floor that a robot sees from just above it: neighbouring rows are far apart in depth.
#[test]
fn a_floor_at_a_grazing_angle_is_one_surface() {
    let color = Intrinsics { width: 640, height: 480, fx: 600.0, fy: 600.0, cx: 320.0, cy: 240.0 };
    let depth = Intrinsics { width: 640, height: 480, fx: 385.0, fy: 385.0, cx: 320.0, cy: 240.0 };
    let straight = |intrinsics| Camera { intrinsics, distortion: Distortion::None };
    // Color is 5 cm above depth; y is down.
    let color_from_depth = Isometry3::translation(0.0, 0.05, 0.0);
    let cameras = Cameras {
        color: straight(color),
        depth: Some(DepthCamera::Own { camera: straight(depth), color_from_depth }),
    };
    let floor = |camera: &Intrinsics, height: f64| -> Vec<f32> {
        let at = |pixel: u32| {
            let down = (f64::from(pixel / camera.width) - camera.cy) / camera.fy;
            let metres = height / down;
            if down > 0.0 && metres < 8.0 { metres as f32 } else { 0.0 }
        };
        (0..camera.width * camera.height).map(at).collect()
    };
    for height in [0.1, 0.3, 1.0] {
        let registration = Registration::new(cameras).unwrap();
        let found = registration.register(raw(&cameras, floor(&depth, height))).unwrap();
        let truth = floor(&color, height + 0.05);
        // What depth sees too, which does not look as far down.
        let seen = |metres: f32| {
            metres > 0.0 && f64::from(metres) > 1.05 * height * 385.0 / 239.0 && metres < 7.5
        };
        let both: Vec<_> =
            truth.iter().zip(&*found.depth_metres).filter(|(truth, _)| seen(**truth)).collect();
        let right =
            both.iter().filter(|(truth, found)| (*found - *truth).abs() <= 0.01 * *truth).count();
        let share = right as f64 / both.len() as f64;
        assert!(both.len() > 20_000 && share > 0.99, "{height} m: {share:.4} of {}", both.len());
    }
}

#[test]
fn a_phone_s_small_depth_is_enlarged() {
    let cameras = Cameras {
        color: color_camera(Distortion::None),
        depth: Some(DepthCamera::SameLens { width: 80, height: 60 }),
    };
    let small = Camera {
        intrinsics: cameras.color.intrinsics.scaled(80, 60),
        distortion: Distortion::None,
    };
    let registration = Registration::new(cameras).unwrap();
    let seen = depth_of(&small, &Isometry3::identity());
    let truth = depth_of(&cameras.color, &Isometry3::identity());
    let right = |found: &mut dyn Iterator<Item = f32>| {
        let right = truth
            .iter()
            .zip(found)
            .filter(|(truth, found)| (found - **truth).abs() <= 0.01 * **truth);
        right.count() as f64 / truth.len() as f64
    };
    // Control: the nearest pixel, which makes stairs of slanted surfaces.
    let nearest = (0..320 * 240).map(|pixel| seen[pixel / 320 / 4 * 80 + pixel % 320 / 4]);
    let nearest = right(&mut nearest.into_iter());
    let frame = registration.register(raw(&cameras, seen.clone())).unwrap();
    let found = right(&mut frame.depth_metres.iter().copied());
    // What is left are edges, which are half a pixel of depth, two of color, from where they are.
    assert!(found > 0.94 && nearest < found - 0.05, "{found}, nearest {nearest}");
}

#[test]
fn what_is_hidden_from_the_color_camera_stays_hidden() {
    // The column is 15 cm wide; from 5 cm to the left, the wall on its left is seen that color does not see.
    let cameras = Cameras {
        color: color_camera(Distortion::None),
        depth: Some(DepthCamera::Own {
            camera: depth_camera(Distortion::None),
            color_from_depth: beside(),
        }),
    };
    let registration = Registration::new(cameras).unwrap();
    let seen = depth_of(&depth_camera(Distortion::None), &beside());
    let frame = registration.register(raw(&cameras, seen)).unwrap();
    let truth = depth_of(&cameras.color, &Isometry3::identity());
    let is_column = |depth: f32| (1.35..1.6).contains(&depth);
    let through = truth
        .iter()
        .zip(&*frame.depth_metres)
        .filter(|(truth, found)| is_column(**truth) && **found > 1.1 * **truth);
    let column = truth.iter().filter(|depth| is_column(**depth)).count();
    let through = through.count();
    assert!(column > 3000 && through * 50 < column, "{through} of {column}");
}

#[test]
fn a_rectified_picture_is_straight_and_has_no_pixel_made_up() {
    // Color tells the ray: red is x, green is y of the plane z = 1.
    for distortion in [BROWN, RATIONAL, FISHEYE] {
        let camera = color_camera(distortion);
        let optics = Optics::new(&camera);
        let Intrinsics { width, height, .. } = camera.intrinsics;
        let shade = |along: f64| (128.0 + 120.0 * along).round().clamp(0.0, 255.0) as u8;
        let rgb: Vec<u8> = (0..width * height)
            .flat_map(|pixel| {
                let ray = optics.ray([f64::from(pixel % width), f64::from(pixel / width)]);
                ray.map_or([0, 0, 0], |[x, y]| [shade(x), shade(y), 200])
            })
            .collect();
        let cameras = Cameras { color: camera, depth: None };
        let registration = Registration::new(cameras).unwrap();
        let mut frame = raw(&cameras, vec![1.0; (width * height) as usize]);
        frame.rgb = rgb.into();
        frame.labels =
            Some((0..width * height).map(|pixel| u16::from(pixel % width > 161)).collect());
        let frame = registration.register(frame).unwrap();
        let Intrinsics { fx, fy, cx, cy, .. } = frame.intrinsics;
        for (pixel, color) in (0..).zip(frame.rgb.chunks_exact(3)) {
            let ray = [(f64::from(pixel % width) - cx) / fx, (f64::from(pixel / width) - cy) / fy];
            for (axis, along) in ray.into_iter().enumerate() {
                let off = (f64::from(color[axis]) - (128.0 + 120.0 * along)).abs();
                assert!(off <= 1.5, "{distortion:?}: pixel {pixel} is off by {off}");
            }
            assert_eq!(color[2], 200, "{distortion:?}: pixel {pixel} is made up");
        }
        let labels = frame.labels.unwrap();
        assert_eq!((labels[0], labels[width as usize - 1]), (0, 1));
        // Depth through the same lens is straightened with it.
        assert!(frame.depth_metres.iter().all(|depth| (depth - 1.0).abs() < 1e-3));
    }
}

#[test]
fn a_frame_s_own_intrinsics_count() {
    let cameras = Cameras { color: color_camera(BROWN), depth: None };
    let registration = Registration::new(cameras).unwrap();
    let blank = || raw(&cameras, vec![1.0; 320 * 240]);
    let usual = registration.register(blank()).unwrap().intrinsics;
    let mut nearer = blank();
    nearer.intrinsics.fx *= 1.1;
    nearer.intrinsics.fy *= 1.1;
    let own = registration.register(nearer).unwrap().intrinsics;
    assert!(own.fx > 1.05 * usual.fx, "{own:?} and {usual:?}");
    assert_eq!(registration.register(blank()).unwrap().intrinsics, usual);
}

#[test]
fn depth_of_another_time_follows_the_camera() {
    let camera = color_camera(Distortion::None);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.005, -0.03, 0.002));
    let later = Isometry3::from_parts(Translation3::new(0.02, 0.0, 0.01), turn);
    let measured = depth_of(&camera, &later);
    let truth = depth_of(&camera, &Isometry3::identity());
    let wrong = |depth: &[f32]| {
        let both = truth.iter().zip(depth);
        both.filter(|(truth, found)| **found > 0.0 && (*found - *truth).abs() > 0.01 * **truth)
            .count()
    };
    let moved = depth_seen_from(&measured, &camera.intrinsics, &later);
    assert!(wrong(&moved) * 10 < wrong(&measured), "{} and {}", wrong(&moved), wrong(&measured));
    let known = moved.iter().filter(|depth| **depth > 0.0).count();
    assert!(known * 20 > truth.len() * 18, "{known} of {}", truth.len());
}

#[test]
fn a_lens_that_sees_nothing_is_refused() {
    let mut blind = color_camera(BROWN);
    blind.intrinsics.cx = -300.0;
    let refused = Registration::new(Cameras { color: blind, depth: None });
    assert!(matches!(refused, Err(LensError::Blind)));
}

/// Coefficients in another order than OpenCV's: as k4a's struct has them, and with the tangential ones last.
#[test]
fn a_lens_whose_rays_cross_is_refused() {
    let lens = |coefficients| {
        let camera = color_camera(Distortion::BrownConrady(coefficients));
        Registration::new(Cameras { color: camera, depth: None })
    };
    for wrong in [
        [0.5, -2.6, 1.5, 0.4, -2.5, 1.4, 0.0007, -0.0002],
        [0.2, -0.6, 0.5, 0.001, -0.0005, 0.0, 0.0, 0.0],
        [0.0, 0.0, -0.3, 0.0, 0.0, 0.0, 0.0, 0.0],
    ] {
        assert!(matches!(lens(wrong), Err(LensError::Folded)), "{wrong:?}: {:?}", lens(wrong));
    }
    // In OpenCV's order.
    assert!(lens([0.5, -2.6, 0.0007, -0.0002, 1.5, 0.4, -2.5, 1.4]).is_ok());
    assert!(lens([0.2, -0.6, 0.001, -0.0005, 0.5, 0.0, 0.0, 0.0]).is_ok());
}

#[test]
fn a_frame_whose_own_intrinsics_do_not_fit_the_lens_is_refused() {
    let cameras = Cameras { color: color_camera(BROWN), depth: None };
    let registration = Registration::new(cameras).unwrap();
    let mut aside = raw(&cameras, vec![1.0; 320 * 240]);
    aside.intrinsics.cx = -300.0;
    assert!(matches!(registration.register(aside), Err(LensError::Blind)));
    assert!(registration.register(raw(&cameras, vec![1.0; 320 * 240])).is_ok());
}
