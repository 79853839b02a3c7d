//! Up from surfaces: floors, table tops and ceilings are level, walls and cupboards upright.
//!
//! After Gupta, Arbelaez and Malik, *Perceptual Organization and Recognition of Indoor Scenes* (CVPR 2013):
//! from a first guess, surfaces are taken for level or for upright by their angle to it; the direction to
//! which level ones are most parallel and upright ones most perpendicular is the next guess; and so on,
//! with less and less tolerance. Slanted and round surfaces drop out on the way.
//!
//! A camera that is pitched down by more than 45 degrees takes the wall ahead for a ceiling. Then level
//! surfaces face down, or there are none, and a second search begins at what faces up.

use super::facet::View;
use super::map_up::{MapUp, UpSource};
use nalgebra::{SymmetricEigen, UnitVector3, Vector3};

/// Angles within which a surface is taken for level or upright, one after the other, degrees. The first is
/// how far the guess may be off.
const TOLERANCES: &[f64] = &[45.0, 45.0, 30.0, 20.0, 10.0, 10.0, 5.0, 5.0];
/// Those that are left out where the search begins at surfaces that face up.
const STEEP_FROM: usize = 2;
/// How far the guess may be off then, degrees. A wall ahead faces up by so much to a camera that is pitched
/// up by the rest of 90 degrees.
const STEEP_DEGREES: f64 = 60.0;
/// Facets that are looked at; of more, a regular subset.
const MOST_FACETS: usize = 20_000;
/// The tolerance of the confidence.
const COUNTED_DEGREES: f64 = 10.0;
/// How strongly the guess itself counts, as a share of all surfaces. It decides only where they do not.
const GUESS_SHARE: f64 = 1e-3;
/// How much better the direction must fit than the next best one across it, as a share of all surfaces: one
/// wall alone does not say which way along it is up.
const LEAST_MARGIN: f64 = 0.04;
/// The least confidence.
const LEAST_CONFIDENCE: f64 = 0.15;

/// The direction near the guess that the surfaces fit best; `None` if they do not say.
pub(super) fn refined(guess: UnitVector3<f64>, views: &[View<'_>]) -> Option<MapUp> {
    let surfaces = Surfaces::new(guess, views)?;
    let usual = surfaces.search(guess, TOLERANCES);
    match usual {
        Some(found) if surfaces.facing(&found) >= 0.0 => usual,
        _ => surfaces.steep().or(usual),
    }
}

/// All surfaces in the world.
struct Surfaces {
    /// Normals on the side of the camera, and areas.
    facets: Vec<(Vector3<f64>, f64)>,
    /// Sum of the areas.
    total: f64,
    guess: UnitVector3<f64>,
}

impl Surfaces {
    /// `None` if there is no surface.
    fn new(guess: UnitVector3<f64>, views: &[View<'_>]) -> Option<Self> {
        let all = views.iter().map(|view| view.facets.len()).sum::<usize>();
        let stride = all.div_ceil(MOST_FACETS).max(1);
        let facets: Vec<_> = views.iter().flat_map(in_world).step_by(stride).collect();
        let total: f64 = facets.iter().map(|(_, area)| area).sum();
        (total > 0.0).then_some(Self { facets, total, guess })
    }

    /// The direction that the surfaces fit best, from a start on.
    fn search(&self, start: UnitVector3<f64>, tolerances: &[f64]) -> Option<MapUp> {
        let (mut direction, mut margin) = (start, 0.0);
        for degrees in tolerances {
            let (cos, sin) = (degrees.to_radians().cos(), degrees.to_radians().sin());
            (direction, margin) = self.fit(direction, |along| {
                let along = along.abs();
                f64::from(u8::from(along > cos)) - f64::from(u8::from(along < sin))
            });
        }
        let confidence = self.confidence(direction);
        (margin > LEAST_MARGIN * self.total && confidence > LEAST_CONFIDENCE).then_some(MapUp {
            direction,
            source: UpSource::Floor,
            confidence,
        })
    }

    /// The same, from the surfaces on that face up.
    fn steep(&self) -> Option<MapUp> {
        let least = STEEP_DEGREES.to_radians().cos();
        let (start, _) = self.fit(self.guess, |along| f64::from(u8::from(along > least)));
        self.search(start, &TOLERANCES[STEEP_FROM..])
            .filter(|found| found.direction.dot(&self.guess) > least && self.facing(found) > 0.0)
    }

    /// The direction to which those surfaces are most parallel that have weight 1, and most perpendicular
    /// that have weight -1, and how much better it fits than the next best one. `weight` is of the cosine
    /// between a normal and `direction`.
    fn fit(
        &self,
        direction: UnitVector3<f64>,
        weight: impl Fn(f64) -> f64,
    ) -> (UnitVector3<f64>, f64) {
        let guessed = *self.guess * self.guess.transpose() * (GUESS_SHARE * self.total);
        let fit = self.facets.iter().fold(guessed, |fit, (normal, area)| {
            fit + normal * normal.transpose() * (weight(normal.dot(&direction)) * area)
        });
        let eigen = SymmetricEigen::new(fit);
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let best: Vector3<f64> = eigen.eigenvectors.column(order[0]).into_owned();
        let best = if best.dot(&direction) < 0.0 { -best } else { best };
        let margin = eigen.eigenvalues[order[0]] - eigen.eigenvalues[order[1]];
        (UnitVector3::new_normalize(best), margin)
    }

    /// How much more of the surfaces is level or upright than if they faced any way, 0 to 1.
    fn confidence(&self, direction: UnitVector3<f64>) -> f64 {
        let (cos, sin) = (COUNTED_DEGREES.to_radians().cos(), COUNTED_DEGREES.to_radians().sin());
        let fits = |along: f64| along > cos || along < sin;
        let fitting = self.facets.iter().filter(|(normal, _)| fits(normal.dot(&direction).abs()));
        let share = fitting.map(|(_, area)| area).sum::<f64>() / self.total;
        // The share of a sphere that these caps and this belt cover.
        let chance = 1.0 - cos + sin;
        ((share - chance) / (1.0 - chance)).clamp(0.0, 1.0)
    }

    /// The area of level surfaces that face up, less that of those that face down.
    fn facing(&self, up: &MapUp) -> f64 {
        let least = COUNTED_DEGREES.to_radians().cos();
        let along = self.facets.iter().map(|(normal, area)| (normal.dot(&up.direction), area));
        along.filter(|(along, _)| along.abs() > least).map(|(along, area)| along * area).sum()
    }
}

/// Normals in the world, and areas.
fn in_world<'a>(view: &'a View<'a>) -> impl Iterator<Item = (Vector3<f64>, f64)> + 'a {
    let rotation = view.world_from_camera.rotation;
    view.facets.iter().map(move |facet| (rotation * facet.normal, facet.area))
}
