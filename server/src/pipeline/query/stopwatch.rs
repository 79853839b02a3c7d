//! A stopwatch for the steps of a request.

use std::time::Instant;

/// Measures successive steps.
pub(super) struct Stopwatch(Instant);

impl Stopwatch {
    pub(super) fn start() -> Self {
        Self(Instant::now())
    }

    /// Milliseconds since the start or the last lap.
    pub(super) fn lap(&mut self) -> f32 {
        milliseconds_since(std::mem::replace(&mut self.0, Instant::now()))
    }
}

/// Milliseconds since an instant.
pub(super) fn milliseconds_since(instant: Instant) -> f32 {
    instant.elapsed().as_secs_f32() * 1e3
}
