//! Finds the adapters of this machine, opens one and tests it.

mod open;
pub mod selftest;
mod survey;

pub use survey::AdapterReport;
