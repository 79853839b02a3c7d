//! Up from surfaces: floors, table tops and ceilings are level, walls and cupboards upright.
//!
//! After Gupta, Arbelaez and Malik, *Perceptual Organization and Recognition of Indoor Scenes* (CVPR 2013): from
//! a first guess, surfaces are taken for level or for upright by their angle to it; the direction to which
//! level ones are most parallel and upright ones most perpendicular is the next guess; and so on, with less
//! and less tolerance. Slanted and round surfaces drop out on the way.

use super::facet::View;
use super::map_up::{MapUp, UpSource};
use nalgebra::{Matrix3, SymmetricEigen, UnitVector3, Vector3};

/// Angles within which a surface is taken for level or upright, one after the other, degrees. The first is how
/// far the guess may be off.
const TOLERANCES: [f64; 8] = [45.0, 45.0, 30.0, 20.0, 10.0, 10.0, 5.0, 5.0];
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
    let stride = views.iter().map(|view| view.facets.len()).sum::<usize>().div_ceil(MOST_FACETS);
    let facets: Vec<(Vector3<f64>, f64)> =
        views.iter().flat_map(in_world).step_by(stride.max(1)).collect();
    let total: f64 = facets.iter().map(|(_, area)| area).sum();
    if total <= 0.0 {
        return None;
    }
    let mut direction = guess;
    let mut margin = 0.0;
    let guessed = *guess * guess.transpose() * (GUESS_SHARE * total);
    for degrees in TOLERANCES {
        (direction, margin) = step(&facets, direction, degrees, guessed);
    }
    let confidence = confidence(&facets, direction, total);
    (margin > LEAST_MARGIN * total && confidence > LEAST_CONFIDENCE).then_some(MapUp {
        direction,
        source: UpSource::Floor,
        confidence,
    })
}

/// Normals in the world, and areas.
fn in_world<'a>(view: &'a View<'a>) -> impl Iterator<Item = (Vector3<f64>, f64)> + 'a {
    let rotation = view.world_from_camera.rotation;
    view.facets.iter().map(move |facet| (rotation * facet.normal, facet.area))
}

/// The next direction, and how much better it fits than the next best one.
fn step(
    facets: &[(Vector3<f64>, f64)],
    direction: UnitVector3<f64>,
    degrees: f64,
    guessed: Matrix3<f64>,
) -> (UnitVector3<f64>, f64) {
    let (cos, sin) = (degrees.to_radians().cos(), degrees.to_radians().sin());
    let fit = facets.iter().fold(guessed, |fit, (normal, area)| {
        let along = normal.dot(&direction).abs();
        let square = normal * normal.transpose() * *area;
        if along > cos {
            fit + square
        } else if along < sin {
            fit - square
        } else {
            fit
        }
    });
    let eigen = SymmetricEigen::new(fit);
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let best: Vector3<f64> = eigen.eigenvectors.column(order[0]).into_owned();
    let best = if best.dot(&direction) < 0.0 { -best } else { best };
    (UnitVector3::new_normalize(best), eigen.eigenvalues[order[0]] - eigen.eigenvalues[order[1]])
}

/// How much more of the surfaces is level or upright than if they faced any way, 0 to 1.
fn confidence(facets: &[(Vector3<f64>, f64)], direction: UnitVector3<f64>, total: f64) -> f64 {
    let (cos, sin) = (COUNTED_DEGREES.to_radians().cos(), COUNTED_DEGREES.to_radians().sin());
    let fits = |along: f64| along > cos || along < sin;
    let fitting = facets.iter().filter(|(normal, _)| fits(normal.dot(&direction).abs()));
    let share = fitting.map(|(_, area)| area).sum::<f64>() / total;
    // The share of a sphere that these caps and this belt cover.
    let chance = 1.0 - cos + sin;
    ((share - chance) / (1.0 - chance)).clamp(0.0, 1.0)
}
