//! Which direction is up in a map, and where that is known from.
//!
//! In: what senders say, what accelerometers measured, measured surfaces and poses of cameras. Out: a
//! [`MapUp`], from the best of these that there is. Nothing here changes a map: frames are tracked and
//! mapped as if up were not known.

mod facet;
mod gravity;
mod level;
mod map_up;

pub(super) use facet::{Facet, View};
pub use map_up::{MapUp, UpSource};

use nalgebra::{UnitVector3, Vector3};

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
