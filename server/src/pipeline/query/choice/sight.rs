//! Relations as they look from a camera: left of, in front of.

use super::shape::Shape;
use crate::pipeline::query::question::RelationKind;
use lexsplat_gpu::Camera;
use nalgebra::UnitQuaternion;

/// What is nearer has no depth, metres.
const NEAREST_METRES: f32 = 0.05;
/// Share of the points at each end that do not count.
const TRIMMED: f32 = 0.1;

/// How an object lies in a view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight {
    /// Columns of its left and right side, divided by the focal length.
    columns: [f32; 2],
    /// Metres along the camera's axis, to its middle.
    depth: f32,
}

impl Sight {
    /// An object in a view; `None` if it is behind the camera.
    pub(super) fn new(
        shape: &Shape,
        camera: &Camera,
        world_from_level: &UnitQuaternion<f32>,
    ) -> Option<Self> {
        let seen =
            shape.points.iter().map(|point| camera.camera_from_world * (world_from_level * point));
        let in_front: Vec<_> = seen.filter(|point| point.z > NEAREST_METRES).collect();
        if in_front.len() * 2 < shape.points.len() {
            return None;
        }
        let sorted = |of: fn(&nalgebra::Point3<f32>) -> f32| {
            let mut values: Vec<f32> = in_front.iter().map(of).collect();
            values.sort_by(f32::total_cmp);
            values
        };
        let columns = sorted(|point| point.x / point.z);
        let outside = (columns.len() as f32 * TRIMMED) as usize;
        let columns = [columns[outside], columns[columns.len() - 1 - outside]];
        let depths = sorted(|point| point.z);
        Some(Self { columns, depth: depths[depths.len() / 2] })
    }

    /// Whether this object has the relation to the other one. Relations of another kind hold never.
    pub(super) fn holds(&self, kind: RelationKind, other: &Self) -> bool {
        let middle = |sight: &Self| (sight.columns[0] + sight.columns[1]) / 2.0;
        let quarter = (other.columns[1] - other.columns[0]) / 4.0;
        let overlaps = self.columns[0] < other.columns[1] && other.columns[0] < self.columns[1];
        match kind {
            RelationKind::LeftOf => middle(self) < middle(other) - quarter,
            RelationKind::RightOf => middle(self) > middle(other) + quarter,
            RelationKind::InFrontOf => overlaps && self.depth < other.depth,
            RelationKind::Behind => overlaps && self.depth > other.depth,
            _ => false,
        }
    }
}
