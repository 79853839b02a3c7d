//! Directions of any length.

use super::refusal::Refusal;
use lexsplat_proto::v1;
use nalgebra::{UnitVector3, Vector3};

/// The direction of a vector that may be absent.
///
/// # Errors
/// [`Refusal`] names `field` if a number is not finite, or all are so small that there is no direction.
pub(super) fn direction(
    field: &str,
    wire: Option<&v1::Vector3>,
) -> Result<Option<UnitVector3<f64>>, Refusal> {
    let Some(&v1::Vector3 { x, y, z }) = wire else { return Ok(None) };
    let vector = Vector3::new(x, y, z);
    let refuse = |expected: &str| {
        let reason =
            format!("expected {expected}, found ({x}, {y}, {z}): leave it out if it is not known");
        Err(Refusal::new(field, reason))
    };
    if !vector.iter().all(|part| part.is_finite()) {
        return refuse("finite numbers");
    }
    // Divided first: the square of a large number is not finite, and that of a small one is 0.
    let largest = vector.amax();
    if largest < f64::MIN_POSITIVE {
        return refuse("a direction, of any length but 0");
    }
    Ok(Some(UnitVector3::new_normalize(vector / largest)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_have_unit_length_and_others_are_refused() {
        let checked = |x, y, z| direction("up", Some(&v1::Vector3 { x, y, z }));
        assert_eq!(direction("up", None).unwrap(), None);
        for length in [1e-300, 0.5, 9.81, 1e300] {
            let found = checked(0.0, 0.6 * length, -0.8 * length).unwrap().unwrap();
            assert!((*found - Vector3::new(0.0, 0.6, -0.8)).norm() < 1e-12, "{length}: {found:?}");
        }
        let nan = f64::NAN;
        for (x, y, z) in
            [(0.0, 0.0, 0.0), (nan, 0.0, 1.0), (0.0, f64::INFINITY, 0.0), (0.0, 0.0, 1e-310)]
        {
            let refusal = checked(x, y, z).unwrap_err();
            assert_eq!(refusal.field, "up", "{x} {y} {z}");
            assert!(refusal.reason.contains("leave it out"), "{refusal}");
        }
    }
}
