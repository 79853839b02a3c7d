//! The shape of an object in level coordinates: metres, z up.

use nalgebra::{Point3, UnitQuaternion, UnitVector3, Vector3};
use rustc_hash::{FxHashMap as HashMap, FxHashSet as HashSet};

/// Distance of the points that are kept, metres.
const SPACING_METRES: f32 = 0.05;
/// Side of the cells of a footprint, metres.
const CELL_METRES: f32 = 0.1;
/// Share of the points at each end of an axis that do not count: the edge of an object is uncertain.
const TRIMMED: f32 = 0.02;

/// Points on an object's surface, and what follows from them.
#[derive(Clone, Debug)]
pub(super) struct Shape {
    /// About one for each voxel of 5 cm.
    pub points: Vec<Point3<f32>>,
    /// Least corner of the box.
    pub low: Point3<f32>,
    /// Greatest corner.
    pub high: Point3<f32>,
    /// Cells of the floor that it is above.
    cells: HashSet<[i32; 2]>,
}

impl Shape {
    /// Of points of the map's world.
    pub(super) fn new(points: &[Point3<f32>], level_from_world: &UnitQuaternion<f32>) -> Self {
        let voxel =
            |point: &Point3<f32>| point.coords.map(|part| (part / SPACING_METRES).floor() as i32);
        let mut of_voxel: HashMap<Vector3<i32>, Point3<f32>> = HashMap::default();
        for point in points {
            let point = level_from_world * point;
            of_voxel.entry(voxel(&point)).or_insert(point);
        }
        let mut points: Vec<Point3<f32>> = of_voxel.into_values().collect();
        points.sort_by(|a, b| {
            let by = |axis: usize| a[axis].total_cmp(&b[axis]);
            by(0).then(by(1)).then(by(2))
        });
        let (low, high) = extent(&points);
        let cells = points.iter().filter(|point| point.z <= high.z).map(cell).collect();
        Self { points, low, high, cells }
    }

    /// The middle of the box.
    pub(super) fn center(&self) -> Point3<f32> {
        nalgebra::center(&self.low, &self.high)
    }

    /// Diagonal of the box, metres.
    pub(super) fn diagonal(&self) -> f32 {
        (self.high - self.low).norm()
    }

    /// Metres from the lowest point to the highest.
    pub(super) fn height(&self) -> f32 {
        self.high.z - self.low.z
    }

    /// The part of the smaller footprint that lies over the other one, or at most `beside` cells beside it,
    /// 0..1.
    pub(super) fn overlap(&self, other: &Self, beside: i32) -> f32 {
        let (small, large) =
            if self.cells.len() <= other.cells.len() { (self, other) } else { (other, self) };
        let reach = || -beside..=beside;
        let is_near = |[x, y]: &[i32; 2]| {
            reach().any(|i| reach().any(|j| large.cells.contains(&[x + i, y + j])))
        };
        let shared = small.cells.iter().filter(|cell| is_near(cell)).count();
        shared as f32 / small.cells.len().max(1) as f32
    }
}

/// The rotation after which `up` is z.
pub(super) fn level(up: &UnitVector3<f64>) -> UnitQuaternion<f32> {
    let up: Vector3<f32> = up.into_inner().cast();
    // Where up is down, every axis that is level is as good.
    UnitQuaternion::rotation_between(&up, &Vector3::z()).unwrap_or_else(|| {
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f32::consts::PI)
    })
}

fn cell(point: &Point3<f32>) -> [i32; 2] {
    [point.x, point.y].map(|part| (part / CELL_METRES).floor() as i32)
}

/// Least and greatest corner, without the trimmed points.
fn extent(points: &[Point3<f32>]) -> (Point3<f32>, Point3<f32>) {
    let (mut low, mut high) = (Point3::origin(), Point3::origin());
    let outside = (points.len() as f32 * TRIMMED) as usize;
    for axis in 0..3 {
        let mut along: Vec<f32> = points.iter().map(|point| point[axis]).collect();
        along.sort_by(f32::total_cmp);
        low[axis] = along.get(outside).copied().unwrap_or_default();
        high[axis] = along.iter().rev().nth(outside).copied().unwrap_or_default();
    }
    (low, high)
}
