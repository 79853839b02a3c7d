//! The report of an evaluation: numbers for programs (`report.json`), rows and a page for people.

#[cfg(test)]
mod example;
mod page;
mod paper;
mod protocol;
mod record;
mod rows;

pub use page::markdown;
pub use paper::Paper;
pub(crate) use record::Measured;
pub use record::Report;
pub use rows::{Row, rows};
