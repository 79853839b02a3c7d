//! Reference, not for production: decisions and slots by plain loops, in `f32` because comparisons
//! must agree exactly; children in f64.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use lexsplat_gpu::shader::layout::{CHILD, DensifyArguments, FRESH, HUGE};
use lexsplat_gpu::{HostGaussians, Statistics};

/// What becomes of a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It is removed.
    Pruned,
    /// It stays.
    Kept,
    /// It stays, and a copy is added.
    Cloned,
    /// Two children replace it.
    Split,
}

/// The fate of each Gaussian, before the limit on their number.
pub fn decide(
    map: &HostGaussians,
    statistics: &[Statistics],
    rules: &DensifyArguments,
) -> Vec<Fate> {
    let fate = |i: usize| {
        let seen = &statistics[i];
        let (color, language) = (map.color.log_scales[i], map.language.log_scales[i]);
        let within = |scale: [f32; 3], limit: f32| scale.iter().all(|s| *s <= limit);
        let opaque = map.color.opacity_logits[i] >= rules.min_logit
            || map.language.opacity_logits[i] >= rules.min_logit;
        let mut fits = within(color, rules.max_log_scale);
        if rules.either_head == 1 {
            fits &= within(language, rules.max_log_scale);
        }
        let somewhere = map.means[i].iter().all(|metres| metres.abs() < HUGE);
        if !opaque || !fits || !somewhere || seen.largest_radius > rules.max_radius {
            return Fate::Pruned;
        }
        let pulled = seen.gradient_sum >= rules.min_gradient * seen.views;
        if seen.views <= 0.0 || !pulled {
            return Fate::Kept;
        }
        match (within(color, rules.clone_log_scale), within(language, rules.clone_log_scale)) {
            (false, _) => Fate::Split,
            (true, true) => Fate::Cloned,
            (true, false) => Fate::Kept,
        }
    };
    (0..map.len()).map(fate).collect()
}

/// The source of each Gaussian afterwards, with marks; births happen, in order, as long as the map
/// does not get larger than `max_gaussians`.
pub fn source(fates: &[Fate], max_gaussians: usize) -> Vec<u32> {
    let stay = fates.iter().filter(|fate| **fate != Fate::Pruned).count();
    let mut room = max_gaussians.saturating_sub(stay);
    let mut source = Vec::new();
    for (gaussian, fate) in (0u32..).zip(fates) {
        let birth = matches!(fate, Fate::Cloned | Fate::Split) && room > 0;
        match fate {
            Fate::Pruned => {}
            Fate::Cloned if birth => source.extend([gaussian, gaussian | FRESH]),
            Fate::Split if birth => source.extend([gaussian | FRESH | CHILD; 2]),
            _ => source.push(gaussian),
        }
        room -= usize::from(birth);
    }
    source
}

/// A 32-bit hash, PCG-RXS-M-XS (O'Neill 2014).
pub fn hash(x: u32) -> u32 {
    let state = x.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// Three numbers with mean 0 and variance 1, for child 0 or 1 of the Gaussian `parent`.
pub fn normal(seed: u32, parent: u32, child: u32) -> [f64; 3] {
    let stream = hash(hash(parent.wrapping_mul(2).wrapping_add(child)) ^ hash(seed));
    let number = |i: u32| (f64::from(hash(stream.wrapping_add(i)) >> 8) + 0.5) / 16_777_216.0;
    let radius = |i| (-2.0 * f64::ln(number(i))).sqrt();
    let angle = |i| std::f64::consts::TAU * (number(i) - 0.5);
    [radius(0) * angle(2).cos(), radius(0) * angle(2).sin(), radius(1) * angle(3).cos()]
}

/// Where a child is, metres from its parent's mean: R S z.
pub fn offset(rotation: [f32; 4], log_scale: [f32; 3], z: [f64; 3]) -> [f64; 3] {
    let [w, i, j, k] = rotation.map(f64::from);
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
    let along = Vector3::from_fn(|axis, _| f64::from(log_scale[axis]).exp() * z[axis]);
    (rotation * along).into()
}
