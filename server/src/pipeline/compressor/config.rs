//! Settings of the online compression, section `[compressor]`.

use crate::pipeline::network::GENERIC_SIZE;
use crate::pipeline::range::{MAX_COUNT, OutOfRange, above, require, within};
use serde::{Deserialize, Serialize};

/// Implementations of the online stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Leading eigenvectors of running second moments, and a dictionary of what they leave out.
    Linear,
    /// The paper's auto-encoder.
    Mlp,
}

/// How generic codes are compressed further.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CompressorConfig {
    /// Implementation.
    pub stage: Stage,
    /// Channels of an online code, 1 to 32.
    pub code_size: usize,
    /// Linear: the share of all observed codes' squared length that the basis may lose, beyond
    /// what the best basis loses, before it is replaced.
    pub tolerance: f64,
    /// MLP: Adam's step size.
    pub learning_rate: f64,
    /// MLP: steps over the initial keyframes, all together.
    pub initial_steps: usize,
    /// MLP: number of initial keyframes, which share `initial_steps`.
    pub initial_keyframes: usize,
    /// MLP: earlier keyframes that are trained on again at each later one.
    pub replayed: usize,
    /// MLP: seed of the random numbers.
    pub seed: u64,
}

impl Default for CompressorConfig {
    fn default() -> Self {
        Self {
            stage: Stage::Linear,
            code_size: 15,
            tolerance: 1e-3,
            learning_rate: 1e-3,
            initial_steps: 200,
            initial_keyframes: 1,
            replayed: 2,
            seed: 0,
        }
    }
}

impl CompressorConfig {
    /// Checks the range of each number.
    ///
    /// # Errors
    /// [`OutOfRange`] names the first key that is out of range.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        within("compressor.code_size", self.code_size, 1..=GENERIC_SIZE)?;
        within("compressor.tolerance", self.tolerance, 0.0..=1.0)?;
        above("compressor.learning_rate", self.learning_rate, 0.0)?;
        within("compressor.initial_keyframes", self.initial_keyframes, 1..=MAX_COUNT)?;
        require(
            (self.initial_keyframes..=MAX_COUNT).contains(&self.initial_steps),
            "compressor.initial_steps",
            self.initial_steps,
            format!(
                "compressor.initial_keyframes, which is {}, to {MAX_COUNT}",
                self.initial_keyframes
            ),
        )?;
        within("compressor.replayed", self.replayed, 0..=MAX_COUNT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::range::table::assert_checks;

    #[test]
    fn each_number_is_checked() {
        assert_checks(
            "compressor",
            CompressorConfig::check,
            &[
                ("compressor.code_size", |c| c.code_size = 0, |c| c.code_size = 1),
                ("compressor.code_size", |c| c.code_size = 33, |c| c.code_size = 32),
                ("compressor.tolerance", |c| c.tolerance = -1e-3, |c| c.tolerance = 0.0),
                ("compressor.tolerance", |c| c.tolerance = f64::NAN, |c| c.tolerance = 1.0),
                ("compressor.learning_rate", |c| c.learning_rate = 0.0, |c| c.learning_rate = 0.1),
                (
                    "compressor.initial_keyframes",
                    |c| c.initial_keyframes = 0,
                    |c| c.initial_keyframes = 1,
                ),
                ("compressor.replayed", |c| c.replayed = MAX_COUNT + 1, |c| c.replayed = 0),
                ("compressor.initial_steps", |c| c.initial_steps = 0, |c| c.initial_steps = 1),
                (
                    "compressor.initial_steps",
                    |c| (c.initial_steps, c.initial_keyframes) = (2, 3),
                    |c| (c.initial_steps, c.initial_keyframes) = (3, 3),
                ),
            ],
            &["compressor.seed"],
        );
    }

    #[test]
    fn an_impossible_code_size_is_refused_with_the_permitted_range() {
        let read = |text: &str| toml::from_str::<CompressorConfig>(text);
        let config = read("code_size = 12").unwrap();
        assert_eq!((config.code_size, config.check()), (12, Ok(())));
        let error = read("code_size = 33").unwrap().check().unwrap_err().to_string();
        assert_eq!(error, "compressor.code_size is 33: expected 1 to 32");
        assert!(read("code_sizes = 12").is_err());
    }
}
