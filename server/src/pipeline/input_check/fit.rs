//! How well two frames fit together under each reading of their poses and depths.
//!
//! In: two small frames with poses as sent. Out: for each reading, how far the surfaces that both frames show
//! are apart. Points of one frame are seen from the other, in both directions. Color is not compared: it
//! changes with exposure, and is misplaced where depth is not registered to it.

use super::reading::{CONVENTIONS, Convention};
use super::small_frame::SmallFrame;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

/// Every so many columns and rows are compared.
const STEP: usize = 5;
/// A relative difference of depth above this counts as no more than this.
const CAP: f32 = 0.1;
/// Depths that differ by less than this share agree.
const AGREEING: f32 = 0.03;
/// Frames that share less than this part of their points under a reading do not support it.
const LEAST_SHARED: f32 = 0.25;

/// How well two frames fit together under one reading.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Fit {
    /// Mean difference of depth on the shared surface, as a share of the largest one that counts: 0 to 1.
    pub cost: f32,
    /// Share of the shared surface where depths agree, 0 to 1.
    pub agreeing: f32,
}

/// Sums over the points that two frames share.
#[derive(Default)]
struct Sums {
    points: usize,
    shared: usize,
    agreeing: usize,
    difference: f32,
}

impl Sums {
    fn fit(&self) -> Fit {
        if (self.shared as f32) < LEAST_SHARED * self.points as f32 || self.shared == 0 {
            return Fit { cost: 1.0, agreeing: 0.0 };
        }
        let shared = self.shared as f32;
        Fit { cost: self.difference / (CAP * shared), agreeing: self.agreeing as f32 / shared }
    }
}

/// The fits of all conventions with all factors of depth, `[conventions, factors]`, row-major. `None` if a
/// pose is missing.
pub(super) fn fits(a: &SmallFrame, b: &SmallFrame, factors: &[f32]) -> Option<Vec<Fit>> {
    let poses = (a.world_from_camera?, b.world_from_camera?);
    let (points_a, points_b) = (points(a), points(b));
    let of_convention = |convention: &Convention| {
        let world_from_a = convention.world_from_camera(&poses.0);
        let world_from_b = convention.world_from_camera(&poses.1);
        let b_from_a = world_from_b.inverse() * world_from_a;
        let mut sums: Vec<Sums> = factors.iter().map(|_| Sums::default()).collect();
        see(&points_a, &b_from_a, b, factors, &mut sums);
        see(&points_b, &b_from_a.inverse(), a, factors, &mut sums);
        sums.into_iter().map(|sums| sums.fit())
    };
    Some(CONVENTIONS.iter().flat_map(of_convention).collect())
}

/// Points of a frame in its camera's coordinates, in the unit of its depth.
fn points(frame: &SmallFrame) -> Vec<[f32; 3]> {
    let (width, height) = frame.size();
    let camera = &frame.camera;
    let pixels = (0..height)
        .step_by(STEP)
        .flat_map(|row| (0..width).step_by(STEP).map(move |column| (column, row)));
    pixels
        .filter_map(|(column, row)| {
            let depth = frame.depth_metres[row * width + column];
            let x = (column as f32 - camera.cx) / camera.fx;
            let y = (row as f32 - camera.cy) / camera.fy;
            (depth > 0.0).then_some([x * depth, y * depth, depth])
        })
        .collect()
}

/// Looks at the points of one frame from another, for each factor. To scale the depths of both is to divide
/// the way between them.
fn see(
    points: &[[f32; 3]],
    target_from_source: &Isometry3<f64>,
    target: &SmallFrame,
    factors: &[f32],
    sums: &mut [Sums],
) {
    let rotation = target_from_source.rotation.to_rotation_matrix();
    let rotation = rotation.matrix().map(|value| value as f32);
    let row = |at: usize| [rotation[(at, 0)], rotation[(at, 1)], rotation[(at, 2)]];
    let rows = [row(0), row(1), row(2)];
    let dot = |r: [f32; 3], p: &[f32; 3]| r[0] * p[0] + r[1] * p[1] + r[2] * p[2];
    let turned: Vec<[f32; 3]> = points.iter().map(|p| rows.map(|row| dot(row, p))).collect();
    let way = target_from_source.translation.vector.map(|value| value as f32);
    for (factor, sums) in factors.iter().zip(sums) {
        let way = [way[0] / factor, way[1] / factor, way[2] / factor];
        sums.points += turned.len();
        turned.iter().for_each(|point| compare(point, way, target, sums));
    }
}

/// Compares a point, moved by `way`, with the depth that the frame has there.
fn compare(point: &[f32; 3], way: [f32; 3], frame: &SmallFrame, sums: &mut Sums) {
    let camera = &frame.camera;
    let z = point[2] + way[2];
    if z <= 0.0 {
        return;
    }
    let column = (point[0] + way[0]) / z * camera.fx + camera.cx + 0.5;
    let row = (point[1] + way[1]) / z * camera.fy + camera.cy + 0.5;
    let (width, height) = (camera.width as f32, camera.height as f32);
    if !(column >= 0.0 && row >= 0.0 && column < width && row < height) {
        return;
    }
    let depth = frame.depth_metres[row as usize * camera.width as usize + column as usize];
    if depth > 0.0 {
        let difference = (z - depth).abs() / depth;
        sums.shared += 1;
        sums.difference += difference.min(CAP);
        sums.agreeing += usize::from(difference < AGREEING);
    }
}
