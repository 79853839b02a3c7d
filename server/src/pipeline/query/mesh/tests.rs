//! Meshes of known surfaces: a ball seen from all around, a wall with a hole.

use super::depth_view::{DepthView, without_edges};
use super::surface;
use super::triangles::Mesh;
use super::tsdf::{Full, Tsdf};
use super::vertex_codes::VertexCodes;
use lexsplat_gpu::Camera;
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use std::collections::HashMap;

const VOXEL: f32 = 0.05;
const RADIUS: f32 = 0.6;

fn camera(camera_from_world: Isometry3<f32>) -> Camera {
    Camera { width: 96, height: 96, fx: 90.0, fy: 90.0, cx: 47.5, cy: 47.5, camera_from_world }
}

/// The view of a surface that is given by the depth along each ray (x/z, y/z).
fn seen(camera: Camera, depth: impl Fn(&Camera, f32, f32) -> f32) -> DepthView {
    let pixels = 0..camera.pixels();
    let depth = pixels
        .map(|at| ((at % 96) as f32 - camera.cx, (at / 96) as f32 - camera.cy))
        .map(|(u, v)| depth(&camera, u / camera.fx, v / camera.fy))
        .collect::<Vec<f32>>();
    let rgb = depth.iter().flat_map(|_| [0.8, 0.4, 0.2]).collect();
    DepthView { camera, depth, rgb }
}

/// A ball around the origin.
fn ball(camera: &Camera, x: f32, y: f32) -> f32 {
    let centre = camera.camera_from_world * Point3::origin();
    let ray = Vector3::new(x, y, 1.0);
    let along = ray.dot(&centre.coords) / ray.norm_squared();
    let beside = (centre.coords - ray * along).norm_squared();
    if beside > RADIUS * RADIUS {
        return 0.0;
    }
    along - ((RADIUS * RADIUS - beside) / ray.norm_squared()).sqrt()
}

/// Cameras 2 m from the origin that look at it, from the six sides and the eight corners.
fn around() -> Vec<Camera> {
    let mut directions = Vec::new();
    for code in 0..27 {
        let part = |at: i32| (code / 3_i32.pow(at as u32) % 3 - 1) as f32;
        let direction = Vector3::new(part(0), part(1), part(2));
        if direction.norm_squared() != 0.0 && direction.norm_squared() != 2.0 {
            directions.push(direction.normalize());
        }
    }
    let look = |from: Vector3<f32>| {
        let up = if from.z.abs() > 0.9 { Vector3::x() } else { Vector3::z() };
        // `look_at_rh` looks along -z with y up; half a turn about x makes that z forward, y down.
        let view = Isometry3::look_at_rh(&Point3::from(from * 2.0), &Point3::origin(), &up);
        let flip =
            nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f32::consts::PI);
        camera(Isometry3::from_parts(Translation3::identity(), flip) * view)
    };
    directions.into_iter().map(look).collect()
}

fn fused(views: &[DepthView]) -> Mesh {
    let mut tsdf = Tsdf::new(VOXEL, 64 << 20);
    for view in views {
        tsdf.integrate(view).expect("it fits");
    }
    surface::extract(&tsdf)
}

/// Numbers of the edges of only one triangle, and of all edges.
fn open_edges(mesh: &Mesh) -> (usize, usize) {
    let mut count: HashMap<(u32, u32), usize> = HashMap::new();
    for &[a, b, c] in &mesh.faces {
        for (a, b) in [(a, b), (b, c), (c, a)] {
            *count.entry((a.min(b), a.max(b))).or_default() += 1;
        }
    }
    assert!(count.values().all(|&triangles| triangles <= 2), "three triangles share an edge");
    (count.values().filter(|&&triangles| triangles == 1).count(), count.len())
}

fn area(mesh: &Mesh) -> f32 {
    let corner = |at: u32| mesh.positions[at as usize];
    let twice = mesh
        .faces
        .iter()
        .map(|&[a, b, c]| (corner(b) - corner(a)).cross(&(corner(c) - corner(a))).norm());
    twice.sum::<f32>() / 2.0
}

#[test]
fn a_ball_is_closed_round_and_faces_outward() {
    let views: Vec<DepthView> = around().into_iter().map(|camera| seen(camera, ball)).collect();
    let mesh = fused(&views);
    assert_eq!(open_edges(&mesh).0, 0, "closed");
    // Euler: V - E + F = 2 for one closed ball.
    let (vertices, faces) = (mesh.positions.len(), mesh.faces.len());
    assert_eq!(vertices + faces - open_edges(&mesh).1, 2);
    for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
        let radius = position.coords.norm();
        // Grazing views measure along z, not across the surface; the mean is what counts.
        assert!((radius - RADIUS).abs() < VOXEL, "a vertex at {radius} m");
        assert!(normal.dot(&position.coords) > 0.0, "{normal} at {position} faces inward");
    }
    let outward = mesh.positions.iter().zip(&mesh.normals);
    let outward = outward.map(|(at, normal)| normal.dot(&at.coords) / at.coords.norm());
    let mean = outward.sum::<f32>() / vertices as f32;
    assert!(mean > 0.9, "normals agree with the ball's by {mean} in the mean");
    let off = mesh.positions.iter().map(|position| (position.coords.norm() - RADIUS).abs());
    let mean = off.sum::<f32>() / vertices as f32;
    assert!(mean < 0.25 * VOXEL, "{mean} m off in the mean");
    let sphere = 4.0 * std::f32::consts::PI * RADIUS * RADIUS;
    // Bumps of a projective distance at coarse voxels: measured 5.6 % more.
    assert!((area(&mesh) / sphere - 1.0).abs() < 0.08, "{} of {sphere} m2", area(&mesh));
    assert!(mesh.colors.iter().all(|rgb| (rgb[0] - 0.8).abs() < 1e-4), "{:?}", mesh.colors[0]);
    // Negative control: seen from one side it is half a ball, and open.
    let half = fused(&views[..1]);
    assert!(open_edges(&half).0 > 20 && area(&half) < 0.7 * sphere, "{} m2", area(&half));
}

#[test]
fn a_wall_is_flat_and_its_hole_stays_open() {
    let wall = |_: &Camera, x: f32, y: f32| if x.hypot(y) < 0.15 { 0.0 } else { 1.5 };
    let mesh = fused(&[seen(camera(Isometry3::identity()), wall)]);
    assert!(!mesh.faces.is_empty());
    for position in &mesh.positions {
        assert!((position.z - 1.5).abs() < 1e-3, "{position}");
        assert!(position.x.hypot(position.y) > 0.15 * 1.5 - VOXEL, "in the hole: {position}");
    }
    // Towards the camera.
    assert!(mesh.normals.iter().all(|normal| normal.z < -0.99));
    // Negative control: without the hole there is something in the middle.
    let whole = fused(&[seen(camera(Isometry3::identity()), |_, _, _| 1.5)]);
    assert!(whole.positions.iter().any(|p| p.x.hypot(p.y) < 0.1));
}

#[test]
fn surfaces_that_later_views_see_through_disappear() {
    let near =
        seen(camera(Isometry3::identity()), |_, x, y| if x.hypot(y) < 0.3 { 1.0 } else { 0.0 });
    let far = || seen(camera(Isometry3::identity()), |_, _, _| 2.0);
    let at_one_metre = |mesh: &Mesh| mesh.positions.iter().filter(|p| p.z < 1.5).count();
    assert!(at_one_metre(&fused(std::slice::from_ref(&near))) > 50);
    assert_eq!(at_one_metre(&fused(&[near, far(), far(), far(), far(), far()])), 0);
}

#[test]
fn memory_is_limited_and_no_depth_gives_no_mesh() {
    let wall = seen(camera(Isometry3::identity()), |_, _, _| 1.5);
    let mut small = Tsdf::new(VOXEL, 100_000);
    assert_eq!(small.integrate(&wall), Err(Full));
    let no_depth = seen(camera(Isometry3::identity()), |_, _, _| 0.0);
    assert_eq!(fused(&[no_depth]), Mesh::default());
    // A small component is noise.
    let speck =
        seen(camera(Isometry3::identity()), |_, x, y| if x.hypot(y) < 0.02 { 1.0 } else { 0.0 });
    assert_eq!(fused(&[speck]), Mesh::default());
}

#[test]
fn depths_at_edges_are_dropped() {
    let depth = [1.0, 1.02, 1.5, 2.0, 2.0, 0.0];
    assert_eq!(without_edges(&depth, 6, 0.1), [1.0, 0.0, 0.0, 0.0, 2.0, 0.0]);
    assert_eq!(without_edges(&depth, 6, 2.0), depth);
    assert_eq!(without_edges(&[20.0, 20.0], 2, 0.1), [0.0, 0.0]);
}

#[test]
fn vertices_have_the_mean_code_of_the_views_that_see_them() {
    let wall = seen(camera(Isometry3::identity()), |_, _, _| 1.5);
    let mesh = Mesh {
        // In the middle, behind the wall, outside the image.
        positions: vec![
            Point3::new(0.0, 0.0, 1.5),
            Point3::new(0.0, 0.0, 2.0),
            Point3::new(9.0, 0.0, 1.5),
        ],
        ..Mesh::default()
    };
    let image = |value: f32| lexsplat_gpu::LanguageImage {
        width: 96,
        height: 96,
        channels: 2,
        codes: [value, -value].repeat(96 * 96),
        opacity: vec![0.8; 96 * 96],
    };
    let mut codes = VertexCodes::new(&mesh.positions, 2);
    codes.add(&wall, &image(0.8), VOXEL);
    codes.add(&wall, &image(0.4), VOXEL);
    let codes = codes.means();
    assert!((codes[0] - 0.75).abs() < 1e-5 && (codes[1] + 0.75).abs() < 1e-5);
    assert_eq!(codes[2..], [0.0; 4]);
}
