//! Reads Rust sources as syntax trees and says which file imports which, where imports run in circles,
//! and how long files and functions are.
//!
//! The test `tests/borders.rs` holds the project to its declared order of modules. The program prints
//! the same findings for any source folder:
//!
//! ```text
//! cargo run -q -p lexsplat-borders -- circles server/src
//! cargo run -q -p lexsplat-borders -- lengths server/src gpu/src
//! ```
//!
//! Limits: names that a macro generates and methods called on values are not seen; `#[cfg(test)]` items
//! and attributes are skipped.

pub mod graph;
pub mod imports;
pub mod lengths;
pub mod order;
pub mod source;
