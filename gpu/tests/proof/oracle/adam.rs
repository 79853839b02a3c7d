//! Reference, not for production: Adam on one number, in f64.

use lexsplat_gpu::shader::layout::{BETA_FIRST, BETA_SECOND, EPSILON};

/// A parameter with its moments.
#[derive(Clone, Copy, Debug, Default)]
pub struct State {
    /// Value.
    pub value: f64,
    /// First moment.
    pub first: f64,
    /// Second moment.
    pub second: f64,
}

/// Step `t`, counted from 1.
pub fn update(state: State, gradient: f64, rate: f64, t: i32) -> State {
    let (b1, b2) = (f64::from(BETA_FIRST), f64::from(BETA_SECOND));
    let first = b1 * state.first + (1.0 - b1) * gradient;
    let second = b2 * state.second + (1.0 - b2) * gradient * gradient;
    let (m, v) = (first / (1.0 - b1.powi(t)), second / (1.0 - b2.powi(t)));
    State { value: state.value - rate * m / (v.sqrt() + f64::from(EPSILON)), first, second }
}
