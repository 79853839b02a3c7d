//! Lens models: where the ray through a pixel goes.
//!
//! A ray is its point (x, y) on the plane z = 1. A model moves that point; the moved one is scaled and
//! shifted to a pixel as a pinhole camera does. Formulas: Brown 1971 with the rational extension of
//! OpenCV's `calib3d`; Kannala and Brandt 2006, equation 6, with four terms.

/// Rays beyond this radius on the plane z = 1 (80 degrees) have no pixel.
const WIDEST: f64 = 5.671;
/// Steps in which the radius is searched up to which a model is one-to-one.
const STEP: f64 = 0.005;
/// Steps of Newton's method.
const NEWTON_STEPS: usize = 20;
/// A ray is found if it is moved to within this distance of the given point.
const FOUND_WITHIN: f64 = 1e-7;

/// How a lens moves rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// Not at all.
    None,
    /// Brown–Conrady: k1 k2 p1 p2 k3 k4 k5 k6.
    BrownConrady([f64; 8]),
    /// Kannala–Brandt: k1 k2 k3 k4.
    KannalaBrandt([f64; 4]),
}

/// A model with its domain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lens {
    distortion: Distortion,
    /// Radius on the plane z = 1 up to which the model is one-to-one.
    reach: f64,
}

impl Lens {
    pub fn new(distortion: Distortion) -> Self {
        let mut reach = STEP;
        let mut before = 0.0;
        while reach < WIDEST {
            let radius = distortion.radius(reach);
            if radius.is_nan() || radius <= before {
                break;
            }
            (before, reach) = (radius, reach + STEP);
        }
        Self { distortion, reach: reach - STEP }
    }

    /// The moved point; `None` where the model is not one-to-one.
    pub fn distorted(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        // This form of the condition also refuses NaN.
        (x.hypot(y) <= self.reach).then(|| self.distortion.of([x, y]))
    }

    /// The point that is moved to `to`; `None` if there is none.
    pub fn undistorted(&self, to: [f64; 2]) -> Option<[f64; 2]> {
        let mut point = match self.distortion {
            Distortion::None => return self.distorted(to),
            Distortion::BrownConrady(_) => to,
            Distortion::KannalaBrandt(_) => {
                // With coefficients of 0 the distance to the centre is the angle.
                let angle = to[0].hypot(to[1]);
                let scale = if angle > 0.0 { angle.min(1.5).tan() / angle } else { 1.0 };
                to.map(|along| along * scale)
            }
        };
        for _ in 0..NEWTON_STEPS {
            let found = self.distortion.of(point);
            let off = [to[0] - found[0], to[1] - found[1]];
            if off[0].hypot(off[1]) < FOUND_WITHIN {
                return (point[0].hypot(point[1]) <= self.reach).then_some(point);
            }
            let step = self.newton_step(point, found, off)?;
            // No step leaves the domain by much: behind it the model turns back.
            let next = [point[0] + step[0], point[1] + step[1]];
            let shrink = (self.reach / next[0].hypot(next[1])).min(1.0);
            point = next.map(|along| along * shrink);
        }
        None
    }

    /// Whether no two rays near this one go through one pixel, and right stays right.
    pub fn is_one_to_one(&self, [x, y]: [f64; 2]) -> bool {
        const APART: f64 = 1e-4;
        let moved = |x, y| self.distortion.of([x, y]);
        let (left, right) = (moved(x - APART, y), moved(x + APART, y));
        let (above, below) = (moved(x, y - APART), moved(x, y + APART));
        let (across, down) = (
            [0, 1].map(|axis| right[axis] - left[axis]),
            [0, 1].map(|axis| below[axis] - above[axis]),
        );
        across[0] * down[1] - across[1] * down[0] > 0.0
    }

    fn newton_step(&self, point: [f64; 2], found: [f64; 2], off: [f64; 2]) -> Option<[f64; 2]> {
        const DIFFERENCE: f64 = 1e-6;
        let along = |axis: usize| {
            let mut moved = point;
            moved[axis] += DIFFERENCE;
            let there = self.distortion.of(moved);
            [(there[0] - found[0]) / DIFFERENCE, (there[1] - found[1]) / DIFFERENCE]
        };
        let (x, y) = (along(0), along(1));
        let determinant = x[0] * y[1] - y[0] * x[1];
        (determinant.abs() > 1e-9).then(|| {
            [
                (y[1] * off[0] - y[0] * off[1]) / determinant,
                (x[0] * off[1] - x[1] * off[0]) / determinant,
            ]
        })
    }
}

impl Distortion {
    /// Whether there is none.
    pub fn is_none(&self) -> bool {
        match self {
            Self::None => true,
            Self::BrownConrady(coefficients) => coefficients.iter().all(|k| *k == 0.0),
            // With coefficients of 0 it is still a fisheye.
            Self::KannalaBrandt(_) => false,
        }
    }

    /// Where a point at distance `radius` goes, tangential terms apart.
    fn radius(&self, radius: f64) -> f64 {
        match self {
            Self::BrownConrady([k1, k2, _, _, others @ ..]) => {
                let radial = Self::BrownConrady([
                    *k1, *k2, 0.0, 0.0, others[0], others[1], others[2], others[3],
                ]);
                radial.of([radius, 0.0])[0]
            }
            _ => self.of([radius, 0.0])[0],
        }
    }

    fn of(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let square = x * x + y * y;
        match *self {
            Self::None => [x, y],
            Self::BrownConrady([k1, k2, p1, p2, k3, k4, k5, k6]) => {
                let polynomial =
                    |a: f64, b: f64, c: f64| 1.0 + square * (a + square * (b + square * c));
                let radial = polynomial(k1, k2, k3) / polynomial(k4, k5, k6);
                [
                    x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
                    y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
                ]
            }
            Self::KannalaBrandt([k1, k2, k3, k4]) => {
                let radius = square.sqrt();
                if radius < 1e-9 {
                    return [x, y];
                }
                let angle = radius.atan();
                let two = angle * angle;
                let moved = angle * (1.0 + two * (k1 + two * (k2 + two * (k3 + two * k4))));
                [x * moved / radius, y * moved / radius]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A phone, a D435's color, an Azure Kinect's depth and two fisheyes.
    const LENSES: [Distortion; 5] = [
        Distortion::BrownConrady([0.1, -0.2, 0.001, -0.0005, 0.05, 0.0, 0.0, 0.0]),
        Distortion::BrownConrady([-0.3, 0.1, 0.0005, 0.001, -0.02, 0.0, 0.0, 0.0]),
        Distortion::BrownConrady([0.5, -2.6, 0.0007, -0.0002, 1.5, 0.4, -2.5, 1.4]),
        Distortion::KannalaBrandt([0.05, -0.01, 0.003, -0.001]),
        Distortion::KannalaBrandt([0.0; 4]),
    ];

    #[test]
    fn undistorting_is_the_inverse() {
        for distortion in LENSES {
            let lens = Lens::new(distortion);
            for at in 0..400 {
                let (angle, radius) = (f64::from(at) * 0.7, f64::from(at) * 0.002);
                let point = [radius * angle.cos(), radius * angle.sin()];
                let Some(moved) = lens.distorted(point).filter(|_| radius < 0.98 * lens.reach)
                else {
                    continue;
                };
                let back = lens.undistorted(moved).unwrap_or_else(|| panic!("{distortion:?} {at}"));
                let off = (back[0] - point[0]).hypot(back[1] - point[1]);
                assert!(off < 1e-5, "{distortion:?} at radius {radius}: off by {off}");
            }
        }
    }

    #[test]
    fn formulas_have_the_published_values() {
        let moved = |distortion: Distortion, point| distortion.of(point);
        // x (1 + k1 r2 + k2 r4 + k3 r6) + 2 p1 x y + p2 (r2 + 2 x2) by hand, r2 = 0.13.
        let brown = Distortion::BrownConrady([0.1, 0.2, 0.01, 0.02, 0.3, 0.0, 0.0, 0.0]);
        let radial: f64 = 1.0 + 0.1 * 0.13 + 0.2 * 0.0169 + 0.3 * 0.002_197;
        let [x, y] = moved(brown, [0.3, 0.2]);
        assert!((x - (0.3 * radial + 0.02 * 0.06 + 0.02 * (0.13 + 0.18))).abs() < 1e-12);
        assert!((y - (0.2 * radial + 0.01 * (0.13 + 0.08) + 0.04 * 0.06)).abs() < 1e-12);
        // A fisheye without coefficients: the distance to the centre is the angle.
        let [x, _] = moved(Distortion::KannalaBrandt([0.0; 4]), [1.0, 0.0]);
        assert!((x - std::f64::consts::FRAC_PI_4).abs() < 1e-12);
    }

    #[test]
    fn what_a_model_folds_back_has_no_ray() {
        // r (1 - 0.4 r2) is largest at r = 0.913, where it is 0.609.
        let lens = Lens::new(Distortion::BrownConrady([-0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
        assert!((lens.reach - 0.913).abs() < 0.01, "{}", lens.reach);
        assert!(lens.distorted([1.2, 0.0]).is_none() && lens.undistorted([0.7, 0.0]).is_none());
        assert!(lens.undistorted([0.55, 0.0]).is_some());
    }
}
