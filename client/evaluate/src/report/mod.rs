//! The report of an evaluation: numbers for programs (`report.json`), rows and a page for people.

#[cfg(test)]
pub(crate) mod example;
mod label_table;
mod machine;
mod page;
mod paper;
mod protocol;
mod record;
mod rows;
mod scaled;

pub use label_table::{LabelTable, label_table};
pub use page::markdown;
pub use paper::Paper;
pub(crate) use record::Measured;
pub use record::{Refined, Report};
pub use rows::{Row, rows};
pub use scaled::Scaled;
