//! The pose of a frame from features that it shares with a keyframe.
//!
//! In: features of both, with their positions. Out: the rigid motion that brings most matches together
//! (RANSAC on three pairs, then least squares on all that agree), or nothing if too few agree. It needs no
//! initial pose. It is exact to a few centimetres, a start for an alignment.

use crate::features::Features;
use nalgebra::{
    Isometry3, Matrix2, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Triples of pairs that are tried.
const TRIES: usize = 2000;
/// Fewer are tried if the best motion's triples would be missed by all of them with this probability.
const MISSED: f64 = 1e-9;
/// Pairs that must agree with a motion.
const LEAST_PAIRS: usize = 8;
/// Pairs that make a motion certain,
const CERTAIN_PAIRS: usize = 15;
/// if they are spread over the picture by at least this standard deviation, as the tangent of an angle.
const CERTAIN_SPREAD: f64 = 0.08;
/// A pair agrees if its points are brought together to this, metres,
const AGREES_METRES: f64 = 0.02;
/// plus this share of the depth, about five pixels.
const AGREES_SHARE: f64 = 0.015;
/// Fits to the pairs that agree.
const FITS: usize = 3;
const SEED: u64 = 0xfea7;

/// Two positions of one corner: in the frame's camera and in the keyframe's.
type Pair = (Point3<f64>, Point3<f64>);

/// A motion and the number of pairs that agree with it.
#[derive(Clone, Copy, Debug)]
pub struct FeaturePose {
    /// Where the frame's camera is in the keyframe's coordinates.
    pub keyframe_from_camera: Isometry3<f64>,
    /// Pairs that agree with the motion.
    pub pairs: usize,
    /// How far the pairs are spread over the frame: the standard deviation in the direction in which it is
    /// smallest, as the tangent of an angle.
    pub spread: f64,
}

impl FeaturePose {
    /// Whether it is beyond doubt: enough pairs, spread over the picture, agree with it.
    pub fn is_certain(&self) -> bool {
        self.pairs >= CERTAIN_PAIRS && self.spread >= CERTAIN_SPREAD
    }

    /// The motion between a frame and a keyframe that show the same corners.
    pub fn find(frame: &Features, keyframe: &Features) -> Option<Self> {
        let matched = frame.matches(keyframe);
        let pair = |(own, other): &(usize, usize)| (*frame.point(*own), *keyframe.point(*other));
        let pairs: Vec<Pair> = matched.iter().map(pair).collect();
        if pairs.len() < LEAST_PAIRS {
            return None;
        }
        let mut motion = most_agreed(&pairs)?;
        let agreeing = |motion: &Isometry3<f64>| -> Vec<Pair> {
            pairs.iter().filter(|pair| agrees(motion, pair)).copied().collect()
        };
        for _ in 0..FITS {
            motion = fit(&agreeing(&motion))?;
        }
        let agreeing = agreeing(&motion);
        (agreeing.len() >= LEAST_PAIRS).then(|| Self {
            keyframe_from_camera: motion,
            pairs: agreeing.len(),
            spread: spread(&agreeing),
        })
    }
}

/// The motion of three pairs that most pairs agree with. Enough triples are tried for one of three right
/// pairs to be almost certainly among them.
fn most_agreed(pairs: &[Pair]) -> Option<Isometry3<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut best: Option<(usize, Isometry3<f64>)> = None;
    let (mut fitted, mut enough) = (0.0, f64::INFINITY);
    for _ in 0..TRIES {
        if fitted >= enough {
            break;
        }
        let three = [(); 3].map(|()| pairs[rng.random_range(0..pairs.len())]);
        if !is_rigid(&three) {
            continue;
        }
        let Some(motion) = fit(&three) else { continue };
        fitted += 1.0;
        let count = pairs.iter().filter(|pair| agrees(&motion, pair)).count();
        if best.is_none_or(|(most, _)| count > most) {
            best = Some((count, motion));
            let right = (count as f64 / pairs.len() as f64).powi(3);
            enough = MISSED.ln() / (-right).ln_1p();
        }
    }
    best.map(|(_, motion)| motion)
}

/// The smaller standard deviation of the directions x/z, y/z of the frame's points.
fn spread(pairs: &[Pair]) -> f64 {
    let slopes = pairs.iter().map(|(point, _)| Vector2::new(point.x / point.z, point.y / point.z));
    let count = pairs.len() as f64;
    let mean = slopes.clone().sum::<Vector2<f64>>() / count;
    let covariance: Matrix2<f64> =
        slopes.map(|slope| (slope - mean) * (slope - mean).transpose()).sum::<Matrix2<f64>>()
            / count;
    covariance.symmetric_eigenvalues().min().max(0.0).sqrt()
}

fn tolerance(pair: &Pair) -> f64 {
    AGREES_METRES + AGREES_SHARE * pair.0.z.max(pair.1.z)
}

fn agrees(motion: &Isometry3<f64>, pair: &Pair) -> bool {
    (motion * pair.0 - pair.1).norm() <= tolerance(pair)
}

/// Whether three pairs can be one motion: they are apart, and their distances are kept.
fn is_rigid(three: &[Pair; 3]) -> bool {
    [(0, 1), (1, 2), (2, 0)].iter().all(|(i, j)| {
        let (here, there) = (three[*i].0 - three[*j].0, three[*i].1 - three[*j].1);
        let allowed = tolerance(&three[*i]) + tolerance(&three[*j]);
        here.norm() > 3.0 * allowed && (here.norm() - there.norm()).abs() <= allowed
    })
}

/// The rigid motion with the least sum of squared distances (Arun 1987); `None` if the points do not
/// determine one.
fn fit(pairs: &[Pair]) -> Option<Isometry3<f64>> {
    let count = pairs.len() as f64;
    let mean = |point: fn(&Pair) -> Point3<f64>| {
        pairs.iter().map(|pair| point(pair).coords).sum::<nalgebra::Vector3<f64>>() / count
    };
    let (from, to) = (mean(|pair| pair.0), mean(|pair| pair.1));
    let covariance: Matrix3<f64> =
        pairs.iter().map(|(a, b)| (b.coords - to) * (a.coords - from).transpose()).sum();
    let svd = covariance.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mirror = Matrix3::from_diagonal(&[1.0, 1.0, (u * v_t).determinant().signum()].into());
    let rotation = u * mirror * v_t;
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let motion = Isometry3::from_parts(Translation3::from(to - rotation * from), rotation);
    motion.translation.vector.iter().all(|v| v.is_finite()).then_some(motion)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn a_fit_finds_a_motion_and_no_mirror() {
        let motion = Isometry3::new(Vector3::new(0.4, -0.2, 0.3), Vector3::new(0.5, -0.8, 0.2));
        let points = [[0.0, 0.0, 2.0], [1.0, 0.1, 2.2], [-0.3, 0.8, 1.7], [0.5, -0.6, 3.0]];
        let pairs: Vec<Pair> =
            points.iter().map(|p| (Point3::from(*p), motion * Point3::from(*p))).collect();
        let off =
            |found: &Isometry3<f64>| (found.to_homogeneous() - motion.to_homogeneous()).norm();
        let found = fit(&pairs).expect("four points determine a motion");
        assert!(off(&found) < 1e-9, "{found}");
        let flat = fit(&pairs[..3]).expect("three too");
        assert!(off(&flat) < 1e-9, "in a plane, where a mirror image fits as well: {flat}");
        assert!(off(&Isometry3::identity()) > 0.1);
    }

    #[test]
    fn the_motion_of_most_pairs_is_found_among_wrong_ones() {
        let motion = Isometry3::new(Vector3::new(0.2, -0.1, 0.3), Vector3::new(0.1, -0.2, 0.05));
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut point = || {
            let [x, y, z] = [(); 3].map(|()| rng.random_range(-1.0..1.0));
            Point3::new(x, y, z + 2.5)
        };
        let mut pairs = |right: usize, wrong: usize| -> Vec<Pair> {
            let right = (0..right).map(|_| point()).map(|point| (point, motion * point));
            let right: Vec<Pair> = right.collect();
            right.into_iter().chain((0..wrong).map(|_| (point(), point()))).collect()
        };
        let off = |found: Option<Isometry3<f64>>| {
            let found = found.expect("there is a motion");
            (found.to_homogeneous() - motion.to_homogeneous()).norm()
        };
        for wrong in [0, 40, 160] {
            let off = off(most_agreed(&pairs(40, wrong)));
            assert!(off < 1e-9, "{wrong} wrong pairs: {off}");
        }
        assert!(off(most_agreed(&pairs(0, 40))) > 0.1, "where none is right, none is found");
    }

    #[test]
    fn points_on_a_line_are_not_spread() {
        let pairs = |slope: f64| -> Vec<Pair> {
            (0..9)
                .map(|i| {
                    let (x, y) = (f64::from(i % 3) - 1.0, f64::from(i / 3) - 1.0);
                    let point = Point3::new(x, slope * y, 2.0);
                    (point, point)
                })
                .collect()
        };
        assert!(
            (spread(&pairs(1.0)) - (1.0f64 / 6.0).sqrt()).abs() < 1e-9,
            "{}",
            spread(&pairs(1.0))
        );
        assert!(spread(&pairs(0.01)) < 0.01);
    }
}
