//! The map on the device: one mean and two heads per Gaussian, with the optimiser's moments.
//!
//! Disentanglement is this type: colour and language share the mean and nothing else.

use crate::buffer::Buffer;
use crate::device::Gpu;
use crate::error::{GpuError, expect_len};
use crate::gather::Gather;
use crate::kernel::Recorder;
use crate::layout::{Row, rows_for};
use crate::target::{pad_rows, unpad_rows};

/// Most channels of a feature.
pub const MAX_CHANNELS: usize = 64;

/// Gaussians in host memory, in structure-of-arrays form.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HostGaussians {
    /// Centres in the world, metres.
    pub means: Vec<[f32; 3]>,
    /// Colour head: three channels, rgb.
    pub colour: HostHead,
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

/// Parameters of one kind with their moments; rows are in Gaussian order.
pub struct Parameters {
    /// Values.
    pub values: Buffer<Row>,
    /// First moments of the gradient.
    pub first: Buffer<Row>,
    /// Second moments of the gradient.
    pub second: Buffer<Row>,
    /// Rows per Gaussian.
    pub rows: usize,
}

/// One head on the device.
pub struct Head {
    /// Two rows: rotation; log scale and opacity logit.
    pub geometry: Parameters,
    /// Feature, filled with zeros to whole rows.
    pub features: Parameters,
    /// Optimiser steps that each Gaussian took.
    pub steps: Buffer<u32>,
}

/// A map on the device.
pub struct Gaussians {
    gpu: Gpu,
    len: usize,
    capacity: usize,
    channels: usize,
    arrays: Option<Arrays>,
    gather: Option<Gather>,
}

/// All arrays of a map with room for one capacity.
pub struct Arrays {
    /// Centres, one row.
    pub means: Parameters,
    /// Colour head.
    pub colour: Head,
    /// Language head.
    pub language: Head,
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

    fn check(&self, channels: usize) -> Result<(), GpuError> {
        self.colour.check(self.len(), 3)?;
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

    fn geometry(&self) -> Vec<Row> {
        let shapes = self.log_scales.iter().zip(&self.opacity_logits);
        let shapes = shapes.map(|(s, opacity)| [s[0], s[1], s[2], *opacity]);
        self.rotations.iter().copied().zip(shapes).flat_map(|(q, shape)| [q, shape]).collect()
    }

    pub(crate) fn from_rows(geometry: &[Row], features: &[Row], channels: usize) -> Self {
        let shapes = || geometry.iter().skip(1).step_by(2);
        Self {
            rotations: geometry.iter().step_by(2).copied().collect(),
            log_scales: shapes().map(|s| [s[0], s[1], s[2]]).collect(),
            opacity_logits: shapes().map(|s| s[3]).collect(),
            features: unpad_rows(features, channels),
            channels,
        }
    }
}

impl Parameters {
    fn new(gpu: &Gpu, label: &str, capacity: usize, rows: usize) -> Result<Self, GpuError> {
        Ok(Self {
            values: Buffer::new(gpu, label, rows * capacity)?,
            first: Buffer::new(gpu, label, rows * capacity)?,
            second: Buffer::new(gpu, label, rows * capacity)?,
            rows,
        })
    }

    /// Writes new Gaussians from index `start` on, with moments of zero.
    fn write(&self, gpu: &Gpu, start: usize, values: &[Row]) {
        let zeros = vec![[0.0; 4]; values.len()];
        self.values.write(gpu, start * self.rows, values);
        self.first.write(gpu, start * self.rows, &zeros);
        self.second.write(gpu, start * self.rows, &zeros);
    }
}

impl Head {
    fn new(gpu: &Gpu, label: &str, capacity: usize, rows: usize) -> Result<Self, GpuError> {
        Ok(Self {
            geometry: Parameters::new(gpu, label, capacity, 2)?,
            features: Parameters::new(gpu, label, capacity, rows)?,
            steps: Buffer::new(gpu, label, capacity)?,
        })
    }

    fn write(&self, gpu: &Gpu, start: usize, head: &HostHead) {
        self.geometry.write(gpu, start, &head.geometry());
        self.features.write(gpu, start, &pad_rows(&head.features, head.channels));
        self.steps.write(gpu, start, &vec![0; head.rotations.len()]);
    }

    fn read(&self, gpu: &Gpu, len: usize, channels: usize) -> Result<HostHead, GpuError> {
        let geometry = self.geometry.values.read(gpu, 2 * len)?;
        let features = self.features.values.read(gpu, self.features.rows * len)?;
        Ok(HostHead::from_rows(&geometry, &features, channels))
    }
}

impl Arrays {
    fn new(gpu: &Gpu, capacity: usize, channels: usize) -> Result<Self, GpuError> {
        Ok(Self {
            means: Parameters::new(gpu, "means", capacity, 1)?,
            colour: Head::new(gpu, "colour head", capacity, 1)?,
            language: Head::new(gpu, "language head", capacity, rows_for(channels))?,
        })
    }

    /// Every buffer with its words per Gaussian, in a fixed order.
    fn buffers(&self) -> Vec<(&wgpu::Buffer, usize)> {
        let mut buffers: Vec<(&wgpu::Buffer, usize)> = Vec::new();
        let (colour, language) = (&self.colour, &self.language);
        let parameters = [
            &self.means,
            &colour.geometry,
            &colour.features,
            &language.geometry,
            &language.features,
        ];
        for kind in parameters {
            buffers
                .extend([&kind.values, &kind.first, &kind.second].map(|b| (&**b, 4 * kind.rows)));
        }
        buffers.extend([&colour.steps, &language.steps].map(|steps| (&**steps, 1)));
        buffers
    }
}

impl Gaussians {
    /// An empty map whose language codes have `language_channels` values, 1 to [`MAX_CHANNELS`].
    pub fn new(gpu: &Gpu, language_channels: usize) -> Self {
        let gpu = gpu.clone();
        Self { gpu, len: 0, capacity: 0, channels: language_channels, arrays: None, gather: None }
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Length of a language code.
    pub fn language_channels(&self) -> usize {
        self.channels
    }

    /// Appends Gaussians; the optimiser starts afresh for them and goes on for the others.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`] when lengths disagree, [`GpuError::OutOfMemory`]; the map is
    /// then as it was.
    pub fn append(&mut self, more: &HostGaussians) -> Result<(), GpuError> {
        more.check(self.channels)?;
        if more.is_empty() {
            return Ok(());
        }
        self.gpu.check()?;
        self.reserve(self.len + more.len())?;
        let arrays = self.arrays.as_ref().expect("reserved above");
        let means: Vec<Row> = more.means.iter().map(|m| [m[0], m[1], m[2], 0.0]).collect();
        arrays.means.write(&self.gpu, self.len, &means);
        arrays.colour.write(&self.gpu, self.len, &more.colour);
        arrays.language.write(&self.gpu, self.len, &more.language);
        self.len += more.len();
        Ok(())
    }

    /// Keeps the Gaussians whose flag is set, in order, with their moments.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`] unless there is one flag per Gaussian,
    /// [`GpuError::OutOfMemory`]; the map is then as it was.
    pub fn retain(&mut self, keep: &[bool]) -> Result<(), GpuError> {
        expect_len("keep", self.len, keep.len())?;
        let index: Vec<u32> =
            (0u32..).zip(keep).filter(|(_, keep)| **keep).map(|(i, _)| i).collect();
        let Some(old) = self.arrays.as_ref().filter(|_| index.len() < self.len) else {
            return Ok(());
        };
        if self.gather.is_none() {
            self.gather = Some(Gather::new(&self.gpu)?);
        }
        let gather = self.gather.as_ref().expect("made above");
        let new = Arrays::new(&self.gpu, self.capacity, self.channels)?;
        let kept = Buffer::from_slice(&self.gpu, "kept", &index)?;
        let mut recorder = Recorder::new(&self.gpu)?;
        for ((from, width), (to, _)) in old.buffers().into_iter().zip(new.buffers()) {
            gather.gather(&mut recorder, &kept, (from, to), width);
        }
        recorder.submit();
        self.arrays = Some(new);
        self.len = index.len();
        Ok(())
    }

    /// Reads the parameters back.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn to_host(&self) -> Result<HostGaussians, GpuError> {
        let Some(arrays) = &self.arrays else {
            let head = |channels| HostHead { channels, ..HostHead::default() };
            let (colour, language) = (head(3), head(self.channels));
            return Ok(HostGaussians { means: Vec::new(), colour, language });
        };
        let means = arrays.means.values.read(&self.gpu, self.len)?;
        Ok(HostGaussians {
            means: means.iter().map(|m| [m[0], m[1], m[2]]).collect(),
            colour: arrays.colour.read(&self.gpu, self.len, 3)?,
            language: arrays.language.read(&self.gpu, self.len, self.channels)?,
        })
    }

    /// Replaces all language codes (`len` x channels) and starts their moments afresh.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`].
    pub fn set_language_features(&mut self, features: &[f32]) -> Result<(), GpuError> {
        expect_len("features", self.len * self.channels, features.len())?;
        if let Some(arrays) = &self.arrays {
            arrays.language.features.write(&self.gpu, 0, &pad_rows(features, self.channels));
        }
        Ok(())
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        let buffers = self.arrays.as_ref().map(Arrays::buffers).unwrap_or_default();
        buffers.iter().map(|(buffer, _)| buffer.size()).sum()
    }

    /// The arrays; none as long as nothing was appended.
    pub(crate) fn arrays(&self) -> Option<&Arrays> {
        self.arrays.as_ref()
    }

    /// Number of Gaussians that fit without a new allocation.
    pub(crate) fn capacity(&self) -> usize {
        self.capacity
    }

    fn reserve(&mut self, len: usize) -> Result<(), GpuError> {
        if len <= self.capacity {
            return Ok(());
        }
        let capacity = len.max(self.capacity + self.capacity / 2).max(1024);
        let new = Arrays::new(&self.gpu, capacity, self.channels)?;
        if let Some(old) = &self.arrays {
            let mut encoder = self.gpu.device().create_command_encoder(&Default::default());
            for ((from, width), (to, _)) in old.buffers().into_iter().zip(new.buffers()) {
                let bytes = (self.len * width * size_of::<u32>()) as u64;
                encoder.copy_buffer_to_buffer(from, 0, to, 0, bytes);
            }
            self.gpu.queue().submit([encoder.finish()]);
        }
        self.arrays = Some(new);
        self.capacity = capacity;
        Ok(())
    }
}
