//! Settings of the networks, section `[language]`.

use crate::pipeline::network::{BundleOptions, Provider};
use crate::pipeline::range::{MAX_COLUMNS, MAX_KEPT, OutOfRange, within};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The most threads of one network.
const MAX_THREADS: usize = 1024;

/// Which networks are loaded, and how they run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LanguageConfig {
    /// Folder of the bundle. A relative path is also looked up beside the executable and in the
    /// folders above it.
    pub models: PathBuf,
    /// ONNX Runtime's shared library; `None`: `ORT_DYLIB_PATH`, or else the one of `make deps`.
    pub runtime: Option<PathBuf>,
    /// Execution providers, preferred ones first. If `cpu` is not among them, one of them must
    /// work.
    pub providers: Vec<Provider>,
    /// Threads of one network; 0: one for each core.
    pub threads: usize,
    /// Keyframes that may wait for the networks. A full queue refuses further ones.
    pub queue: usize,
    /// Whether the super-resolution decoder runs, where the bundle has it as a separate graph. If
    /// not, coarse features are resampled bilinearly.
    pub srd: bool,
    /// Labels that come with a frame are stored at this many columns at most.
    pub label_columns: usize,
}

impl Default for LanguageConfig {
    fn default() -> Self {
        Self {
            models: "models/tiny".into(),
            runtime: None,
            providers: vec![Provider::Cpu],
            threads: 0,
            queue: 4,
            srd: true,
            label_columns: 300,
        }
    }
}

impl LanguageConfig {
    /// Checks the range of each number.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        within("language.threads", self.threads, 0..=MAX_THREADS)?;
        within("language.queue", self.queue, 1..=MAX_KEPT)?;
        within("language.label_columns", self.label_columns, 1..=MAX_COLUMNS as usize)
    }
}

impl<'a> From<&'a LanguageConfig> for BundleOptions<'a> {
    fn from(config: &'a LanguageConfig) -> Self {
        Self {
            models: &config.models,
            runtime: config.runtime.as_deref(),
            providers: &config.providers,
            threads: config.threads,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::range::table::assert_checks;

    #[test]
    fn each_number_is_checked() {
        assert_checks(
            "language",
            LanguageConfig::check,
            &[
                ("language.threads", |c| c.threads = MAX_THREADS + 1, |c| c.threads = 1),
                ("language.queue", |c| c.queue = 0, |c| c.queue = 1),
                ("language.label_columns", |c| c.label_columns = 0, |c| c.label_columns = 1),
            ],
            &[],
        );
    }
}
