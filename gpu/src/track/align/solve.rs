//! Levenberg-Marquardt on each level, from the coarsest to the finest. Needs no device: a function
//! returns the normal systems.

use nalgebra::Matrix6;

use super::{AlignSettings, Estimate, NormalSystem, PoseStep, Prior};

/// Damping of the first step of a level.
const FIRST_DAMPING: f64 = 1e-4;
/// Damping goes up or down by this factor.
const DAMPING_FACTOR: f64 = 10.0;
/// Damping after a step that raised the cost: the least that shortens the next one.
const RETRY_DAMPING: f64 = 0.1;
/// A step that changes the exposure by more is looked at, however little it moves.
const SMALLEST_EXPOSURE: f64 = 5e-3;
/// With noisy measurements a step is also small if it promises to lower the cost by no more than this part of
/// it, four times as much with each coarser level,
const LITTLE: f64 = 3e-3;
/// and if it is not longer than this many times the smallest step.
const FARTHEST_UNSEEN: f64 = 10.0;
/// Measurements are noisy if more cost than this is left per residual. Exact pictures leave 0.01, a Kinect
/// 0.03 to 0.17.
const NOISY: f64 = 0.02;
/// Steps are at most doubled because the cost curves less than the system says.
const LEAST_CURVATURE: f64 = 0.5;
/// A step that changes the cost by no more than this part of it was taken at the bottom.
const FLAT: f64 = 1e-3;
/// A step that loses more of the residuals has left the scene, however low their cost.
const KEPT: f64 = 0.5;
/// Damping stays between these.
const DAMPING_RANGE: (f64, f64) = (1e-8, 1e3);

/// How the levels are gone through.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// Most steps per level, finest first; a level with none is skipped.
    pub steps: Vec<usize>,
    /// Weights, thresholds and gates; [`AlignSettings::at_level`] widens them on coarse levels.
    pub settings: AlignSettings,
    /// Whether the exposure is estimated.
    pub with_exposure: bool,
    /// Prior knowledge of the pose.
    pub prior: Option<Prior>,
    /// A level is done with a step that moves less than this: |[rho, theta]|, metres and radians,
    /// four times as much with each coarser level. Such a step is taken without another look. A
    /// level is also done when a step hardly changes the cost, or promises to.
    pub smallest_step: f64,
}

impl Default for Schedule {
    /// Three levels of 3, 4 and 6 steps.
    fn default() -> Self {
        Self {
            steps: vec![3, 4, 6],
            settings: AlignSettings::default(),
            with_exposure: true,
            prior: None,
            smallest_step: 1e-4,
        }
    }
}

/// Where the live image was taken, and how far that can be believed.
#[derive(Clone, Debug, PartialEq)]
pub struct Aligned {
    /// Pose and exposure.
    pub estimate: Estimate,
    /// Information of [rho, theta] at the estimate, left perturbation, without the prior's; see
    /// [`NormalSystem::information`].
    pub information: Matrix6<f64>,
    /// Smallest over largest eigenvalue of the information; near 0 when some motion is not seen.
    pub conditioning: f64,
    /// The last level's system: costs and counts. It is at the estimate, or less than
    /// [`Schedule::smallest_step`] away.
    pub system: NormalSystem,
    /// Systems that were summed.
    pub evaluations: usize,
    /// True if the last level was done before its steps were used up.
    pub converged: bool,
}

impl Aligned {
    /// Part of the live pixels with depth that fall into the reference image, 0 to 1.
    pub fn overlap(&self) -> f64 {
        share(self.system.counts.inside, self.system.counts.live)
    }

    /// Part of the live pixels with depth whose intensity agrees with the reference, 0 to 1.
    pub fn photometric_inliers(&self) -> f64 {
        share(self.system.counts.photometric_inliers, self.system.counts.live)
    }

    /// Part of the live pixels with depth that lie on the reference's surface, 0 to 1.
    pub fn geometric_inliers(&self) -> f64 {
        share(self.system.counts.geometric_inliers, self.system.counts.live)
    }
}

/// Moves `start` to where the cost per residual is least. `system(level, estimate)` sums one normal
/// system. A level without a solvable system leaves the estimate as it is, which shows in the
/// conditioning and the counts of [`Aligned`].
///
/// # Errors
/// Those of `system`.
pub fn align<E>(
    start: &Estimate,
    schedule: &Schedule,
    mut system: impl FnMut(usize, &Estimate) -> Result<NormalSystem, E>,
) -> Result<Aligned, E> {
    let mut state = State { estimate: *start, evaluations: 0, converged: false, curvature: 1.0 };
    let mut last = None;
    for (level, steps) in schedule.steps.iter().enumerate().rev() {
        if *steps > 0 {
            last = Some(state.descend(schedule, level, |estimate| system(level, estimate))?);
        }
    }
    let system = match last {
        Some(system) => system,
        None => {
            state.evaluations += 1;
            system(0, start)?
        }
    };
    Ok(Aligned {
        estimate: state.estimate,
        information: system.information(schedule.with_exposure),
        conditioning: system.conditioning(schedule.with_exposure, None),
        system,
        evaluations: state.evaluations,
        converged: state.converged,
    })
}

struct State {
    estimate: Estimate,
    evaluations: usize,
    converged: bool,
    /// The cost's curvature along the last step as a part of the system's. A robust cost curves less than its
    /// weighted squares, which makes steps too short, each by the same part.
    curvature: f64,
}

impl State {
    /// Minimises on one level; returns the system at the final estimate, or where the last small step
    /// began.
    fn descend<E>(
        &mut self,
        schedule: &Schedule,
        level: usize,
        mut system: impl FnMut(&Estimate) -> Result<NormalSystem, E>,
    ) -> Result<NormalSystem, E> {
        let prior = schedule.prior.as_ref();
        let mut current = system(&self.estimate)?;
        let mut damping = FIRST_DAMPING;
        self.evaluations += 1;
        self.converged = false;
        for _ in 0..schedule.steps[level] {
            let with_prior = prior.map(|prior| (prior, &self.estimate));
            let Some(step) = current.solve(damping, schedule.with_exposure, with_prior) else {
                break;
            };
            // A step that damping made short says nothing of the bottom.
            let is_free = damping < RETRY_DAMPING;
            let stretch = if is_free && prior.is_none() { 1.0 / self.curvature } else { 1.0 };
            let step = step.stretched(stretch);
            let trial = self.estimate.moved(&step);
            let all = whole_cost(&current, &self.estimate, prior);
            let noise = all / f64::from(current.residuals().max(1));
            // Exact pictures tell even the smallest steps.
            let promised = if noise > NOISY { step.promised / all } else { f64::INFINITY };
            if is_free && is_small(&step, promised, schedule.smallest_step, level) {
                (self.estimate, self.converged) = (trial, true);
                break;
            }
            let next = system(&trial)?;
            self.evaluations += 1;
            let costs = [cost(&current, &self.estimate, prior), cost(&next, &trial, prior)];
            let better = costs[1] <= costs[0]
                && f64::from(next.residuals()) >= KEPT * f64::from(current.residuals());
            let done = is_free && (costs[1] - costs[0]).abs() <= FLAT * costs[0];
            if better {
                if is_free && prior.is_none() {
                    self.learn_curvature(&step, stretch, [&current, &next]);
                }
                (self.estimate, current) = (trial, next);
                damping /= DAMPING_FACTOR;
            } else {
                damping = (damping * DAMPING_FACTOR).max(RETRY_DAMPING);
            }
            damping = damping.clamp(DAMPING_RANGE.0, DAMPING_RANGE.1);
            if done {
                self.converged = true;
                break;
            }
        }
        Ok(current)
    }

    /// How much the cost's slope along a step changed, of what the system before had promised.
    fn learn_curvature(&mut self, step: &PoseStep, stretch: f64, systems: [&NormalSystem; 2]) {
        let [before, after] = systems.map(|system| step.along(&system.g));
        let part = (1.0 - after / before) / stretch;
        if part.is_finite() {
            self.curvature = part.clamp(LEAST_CURVATURE, 1.0);
        }
    }
}

/// Whether a step is taken without another look. `promised`: by which part the cost falls with it.
fn is_small(step: &PoseStep, promised: f64, smallest_step: f64, level: usize) -> bool {
    let factor = 4f64.powi(level.min(8) as i32);
    let length = step.tau.norm() / factor;
    let is_short = length < smallest_step
        || (length < FARTHEST_UNSEEN * smallest_step && promised <= factor * LITTLE);
    is_short && step.exposure.iter().all(|change| change.abs() < SMALLEST_EXPOSURE)
}

/// Cost per residual, so that estimates with different numbers of them can be compared; infinite
/// without any.
fn cost(system: &NormalSystem, estimate: &Estimate, prior: Option<&Prior>) -> f64 {
    match system.residuals() {
        0 => f64::INFINITY,
        residuals => whole_cost(system, estimate, prior) / f64::from(residuals),
    }
}

fn whole_cost(system: &NormalSystem, estimate: &Estimate, prior: Option<&Prior>) -> f64 {
    system.cost() + prior.map_or(0.0, |prior| prior.cost(&estimate.reference_from_live))
}

fn share(part: u32, whole: u32) -> f64 {
    f64::from(part) / f64::from(whole.max(1))
}
