//! Gaussians in host memory, in structure-of-arrays form, and their rows.

use crate::device::{GpuError, expect_len};
use crate::shader::layout::Row;

/// Gaussians in host memory, in structure-of-arrays form.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HostGaussians {
    /// Centres in the world, metres.
    pub means: Vec<[f32; 3]>,
    /// Color head: three channels, rgb.
    pub color: HostHead,
    /// Language head: one code per Gaussian.
    pub language: HostHead,
}

/// One head of Gaussians in host memory.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HostHead {
    /// Quaternions (w, x, y, z), of any length but zero.
    pub rotations: Vec<[f32; 4]>,
    /// Natural logarithms of the standard deviations, metres.
    pub log_scales: Vec<[f32; 3]>,
    /// Logits of the opacities.
    pub opacity_logits: Vec<f32>,
    /// Features, `channels` per Gaussian.
    pub features: Vec<f32>,
    /// Length of a feature.
    pub channels: usize,
}

impl HostGaussians {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    pub(super) fn check(&self, channels: usize) -> Result<(), GpuError> {
        self.color.check(self.len(), 3)?;
        self.language.check(self.len(), channels)
    }
}

impl HostHead {
    fn check(&self, len: usize, channels: usize) -> Result<(), GpuError> {
        if len > 0 {
            expect_len("channels", channels, self.channels)?;
        }
        expect_len("rotations", len, self.rotations.len())?;
        expect_len("log_scales", len, self.log_scales.len())?;
        expect_len("opacity_logits", len, self.opacity_logits.len())?;
        expect_len("features", len * channels, self.features.len())
    }

    pub(super) fn geometry(&self) -> Vec<Row> {
        let shapes = self.log_scales.iter().zip(&self.opacity_logits);
        let shapes = shapes.map(|(s, opacity)| [s[0], s[1], s[2], *opacity]);
        self.rotations.iter().copied().zip(shapes).flat_map(|(q, shape)| [q, shape]).collect()
    }

    pub(crate) fn from_rows(geometry: &[Row], features: Vec<f32>, channels: usize) -> Self {
        let mut head = Self::with_capacity(geometry.len() / 2, channels);
        head.extend_geometry(geometry);
        Self { features, ..head }
    }

    /// No Gaussian, with room for the geometry of `len`.
    pub(super) fn with_capacity(len: usize, channels: usize) -> Self {
        Self {
            rotations: Vec::with_capacity(len),
            log_scales: Vec::with_capacity(len),
            opacity_logits: Vec::with_capacity(len),
            features: Vec::new(),
            channels,
        }
    }

    /// Adds the geometry of some Gaussians, two rows each.
    pub(super) fn extend_geometry(&mut self, geometry: &[Row]) {
        let shapes = || geometry.iter().skip(1).step_by(2);
        self.rotations.extend(geometry.iter().step_by(2));
        self.log_scales.extend(shapes().map(|s| [s[0], s[1], s[2]]));
        self.opacity_logits.extend(shapes().map(|s| s[3]));
    }
}
