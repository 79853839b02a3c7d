//! An object with the Gaussians that it consists of.

use super::gaussian::RelevantGaussian;
use super::surface;
use crate::pipeline::query::answer::Object;
use lexsplat_gpu::HostGaussians;
use nalgebra::Point3;

/// An object that was found.
pub(crate) struct FoundObject {
    pub object: Object,
    /// Its Gaussians, in the map's order.
    pub members: Vec<RelevantGaussian>,
}

impl FoundObject {
    /// Indices of its Gaussians in the map.
    pub(crate) fn rows(&self) -> impl Iterator<Item = u32> {
        self.members.iter().map(|member| member.row)
    }

    /// Points on its surface, 2 cm apart, in the map's world.
    pub(crate) fn surface(&self, gaussians: &HostGaussians) -> Vec<Point3<f32>> {
        let points = surface::sample(&gaussians.language, &self.members);
        points.into_iter().map(|point| point.position).collect()
    }

    /// The part of the larger object's Gaussians that belong to both, 0..1.
    pub(crate) fn shared(&self, other: &Self) -> f32 {
        let shared = self.members.iter().filter(|member| other.has(member.row)).count();
        shared as f32 / self.members.len().max(other.members.len()).max(1) as f32
    }

    /// This object without the Gaussians of another one.
    pub(crate) fn without(&self, other: &Self) -> Self {
        let rest = self.members.iter().filter(|member| !other.has(member.row)).copied();
        Self { object: self.object.clone(), members: rest.collect() }
    }

    fn has(&self, row: u32) -> bool {
        self.members.binary_search_by_key(&row, |member| member.row).is_ok()
    }
}
