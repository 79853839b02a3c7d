//! Gaussians as clustering sees them: balls with a relevancy.

use crate::pipeline::query::answer::ScoredPoint;
use crate::pipeline::query::relevancy::Evidenced;
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::HostGaussians;
use nalgebra::Point3;

/// Opacity of the language head below which a Gaussian belongs to no object.
const MIN_OPACITY: f32 = 0.3;
/// Radius of a Gaussian's ball, standard deviations.
const DEVIATIONS: f32 = 2.0;
/// The largest radius, metres. It limits how far large Gaussians connect others.
const MAX_RADIUS_METRES: f32 = 0.2;

/// A relevant Gaussian.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RelevantGaussian {
    /// Index in the map.
    pub row: u32,
    /// Centre and relevancy.
    pub point: ScoredPoint,
    /// Opacity of the language head, 0..1.
    pub opacity: f32,
    /// Spread of the codes that keyframes have there, greater than 0.
    pub spread: f32,
    /// Radius of the ball that clustering uses, metres, at least 0.
    pub radius: f32,
}

impl RelevantGaussian {
    /// Gaussian `row` of a map with its relevancy; `None` if it belongs to no object.
    pub(super) fn new(snapshot: &MapSnapshot, row: u32, score: f32) -> Option<Self> {
        let (position, opacity) = opaque_centre(&snapshot.gaussians, row)?;
        let radius = radius(snapshot.gaussians.language.log_scales[row as usize]);
        let spread = snapshot.sightings()[row as usize].spread;
        Some(Self { row, point: ScoredPoint { position, score }, opacity, spread, radius })
    }

    /// Its relevancy and spread.
    pub(super) fn evidenced(&self) -> Evidenced {
        Evidenced { relevancy: self.point.score, spread: self.spread }
    }
}

/// Centre and opacity of a Gaussian; `None` if it is too transparent or not finite.
pub(super) fn opaque_centre(gaussians: &HostGaussians, row: u32) -> Option<(Point3<f32>, f32)> {
    let position = Point3::from(gaussians.means[row as usize]);
    let opacity = sigmoid(gaussians.language.opacity_logits[row as usize]);
    let counts = opacity > MIN_OPACITY && position.iter().all(|c| c.is_finite());
    counts.then_some((position, opacity))
}

/// Radius of the ball of two standard deviations (geometric mean over the axes), metres.
fn radius([x, y, z]: [f32; 3]) -> f32 {
    (DEVIATIONS * ((x + y + z) / 3.0).exp()).min(MAX_RADIUS_METRES)
}

fn sigmoid(logit: f32) -> f32 {
    1.0 / (1.0 + (-logit).exp())
}
