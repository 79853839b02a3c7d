//! From a keyframe to its language (paper §4.1): image encoder, super-resolution decoder and
//! generic compressor, and the thread that runs them.
//!
//! In: [`Frame`]s. Out: [`LanguageMap`]s, one generic code for each cell of a grid over the image.
//! A frame with labels gets the codes of the labels' texts instead, and its image is not encoded.
//! The queue of the thread is bounded: a full queue refuses the frame, so that mapping never waits.
//!
//! [`Frame`]: super::frame::Frame

mod config;
mod error;
mod labels;
mod language_map;
mod prepare;
mod resample;
mod thread;
mod vision;

pub use config::LanguageConfig;
pub use error::LanguageError;
pub use labels::Embed;
pub use language_map::{LanguageMap, LanguageTiming};
pub(crate) use thread::LanguageThread;
pub use vision::Vision;

#[cfg(test)]
mod tests;
