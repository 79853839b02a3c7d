//! Up from accelerometers. At rest one measures the direction up; while the robot speeds up, brakes or
//! shakes it measures something else. The median direction of many readings is hardly moved by those.

use super::map_up::{MapUp, UpSource};
use nalgebra::{UnitVector3, Vector3};

/// A reading within this angle agrees with the median.
const AGREES_DEGREES: f64 = 10.0;
/// Steps of Weiszfeld's method.
const STEPS: usize = 10;
/// Readings nearer than this do not weigh more, radians.
const NEAREST: f64 = 1e-3;

/// The geometric median of unit vectors (Weiszfeld's method). `None` without readings, or if they cancel each
/// other.
pub(super) fn median(readings: &[UnitVector3<f64>]) -> Option<MapUp> {
    let mean: Vector3<f64> = readings.iter().map(|reading| reading.into_inner()).sum();
    let mut direction = UnitVector3::try_new(mean, 1e-6)?;
    for _ in 0..STEPS {
        let weighed = |reading: &UnitVector3<f64>| {
            reading.into_inner() / (reading.into_inner() - *direction).norm().max(NEAREST)
        };
        direction = UnitVector3::try_new(readings.iter().map(weighed).sum(), 1e-6)?;
    }
    let least = AGREES_DEGREES.to_radians().cos();
    let agreeing = readings.iter().filter(|reading| reading.dot(&direction) > least).count();
    // One reading alone may be any acceleration.
    let confidence = agreeing as f64 / (readings.len() + 1) as f64;
    Some(MapUp { direction, source: UpSource::Gravity, confidence })
}
