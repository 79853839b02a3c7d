//! The direction up, with its source.

use nalgebra::UnitVector3;

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
