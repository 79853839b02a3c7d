//! **Load test** of a running server: robots send frames and queries are asked, both at constant
//! rates.
//!
//! The load is open-loop: the time that a frame or a query is due does not depend on the answers
//! before it, and its latency counts from that time. A stalled server therefore shows in the
//! latencies (no coordinated omission). Frames are read or rendered before the clock starts. The
//! maps are deleted afterwards.

mod asker;
mod latency;
mod load;
mod plan;
mod report;
mod robot;

pub use latency::Latencies;
pub use load::run;
pub use plan::Plan;
pub use report::Report;
#[cfg(test)]
pub use report::{FrameReport, QueryReport};
