//! Which direction is up in a map, and where that is known from.
//!
//! In: what senders say, what accelerometers measured, measured surfaces and poses of cameras. Out: a [`MapUp`],
//! from the best of these that there is. Nothing here changes a map; frames are tracked and mapped as if up
//! were not known.

mod facet;
mod gravity;
mod level;

pub(super) use facet::Facet;

use nalgebra::{Isometry3, UnitVector3, Vector3};

/// Where the direction up is known from, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpSource {
    /// The sender of a stream said it.
    Given,
    /// Accelerometers measured it.
    Gravity,
    /// Floors, table tops and ceilings are level, walls upright.
    Floor,
    /// A guess: cameras are held upright.
    Camera,
}

impl UpSource {
    /// The name in statuses.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Given => "given",
            Self::Gravity => "gravity",
            Self::Floor => "floor",
            Self::Camera => "camera",
        }
    }
}

/// The direction up in a map's coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapUp {
    /// The direction.
    pub direction: UnitVector3<f64>,
    /// Where it is known from.
    pub source: UpSource,
    /// How much speaks for it, 0 to 1: 1 if it was given; with gravity the share of the readings within 10
    /// degrees of it; with floors how much more of the surfaces than by chance is level or upright, within 10
    /// degrees; 0 for a guess.
    pub confidence: f64,
}

/// What a keyframe says of the direction up.
pub(super) struct View<'a> {
    pub world_from_camera: &'a Isometry3<f64>,
    /// Surfaces that it measured.
    pub facets: &'a [Facet],
}

/// The direction up of a map; `None` if nothing is known of it.
///
/// `given`: the direction as a sender said it. `readings`: what accelerometers measured, in the map's
/// coordinates. `views`: keyframes.
pub(super) fn of_map(
    given: Option<UnitVector3<f64>>,
    readings: &[UnitVector3<f64>],
    views: &[View<'_>],
) -> Option<MapUp> {
    if let Some(direction) = given {
        return Some(MapUp { direction, source: UpSource::Given, confidence: 1.0 });
    }
    gravity::median(readings).or_else(|| {
        let guess = of_cameras(views)?;
        Some(level::refined(guess, views).unwrap_or(MapUp {
            direction: guess,
            source: UpSource::Camera,
            confidence: 0.0,
        }))
    })
}

/// The average of the cameras' upper sides.
fn of_cameras(views: &[View<'_>]) -> Option<UnitVector3<f64>> {
    let upper = views.iter().map(|view| -(view.world_from_camera.rotation * Vector3::y()));
    UnitVector3::try_new(upper.sum(), 1e-6)
}

#[cfg(test)]
mod tests;
