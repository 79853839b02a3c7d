//! The result of the encoder.

/// A keyframe's language: generic codes on a grid over the whole image.
#[derive(Clone, Debug)]
pub struct LanguageMap {
    /// Columns of the grid.
    pub width: u32,
    /// Rows of the grid.
    pub height: u32,
    /// `[height * width * 32]`, row-major, unit length; zeros where there is no language.
    pub codes: Vec<f32>,
    /// Duration of each step.
    pub timing: LanguageTiming,
}

/// Durations, milliseconds. An end-to-end graph counts as the encoder.
#[derive(Clone, Copy, Debug, Default)]
pub struct LanguageTiming {
    /// Resampling and normalisation of the image.
    pub prepare: f32,
    /// The image encoder.
    pub encoder: f32,
    /// The super-resolution decoder.
    pub srd: f32,
    /// The generic compressor.
    pub compressor: f32,
}
