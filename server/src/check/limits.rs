//! Configured limits on frames.

/// Limits on the images of a stream.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    /// Pixels of an image.
    pub(crate) max_pixels: u64,
    /// Most by which a sequence number may exceed the one before.
    pub(crate) max_sequence_step: u64,
    /// Smaller depths are no measurement, metres.
    pub(crate) min_depth_metres: f32,
    /// Larger depths are no measurement, metres.
    pub(crate) max_depth_metres: f32,
}
