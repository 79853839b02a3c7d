//! The arrays of a map: parameters, moments and step counts, in Gaussian order, and how they grow.

use crate::device::{Buffer, Gpu, GpuError};
use crate::map::host::HostHead;
use crate::map::rows::{pad_rows, unpad_rows};
use crate::shader::layout::{Row, rows_for};

/// Words of four bytes per row.
const ROW_WORDS: usize = 4;
/// Gaussians that are read back at a time.
pub(super) const READ_GAUSSIANS: usize = 1 << 16;
/// Rows of a head's geometry.
const GEOMETRY_ROWS: usize = 2;

/// Parameters of one kind with their moments; rows are in Gaussian order.
pub struct Parameters {
    /// Values.
    pub values: Buffer<Row>,
    /// First moments of the gradient; empty in a map that is only drawn.
    pub first: Buffer<Row>,
    /// Second moments of the gradient, likewise.
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

/// Which of the two heads of a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeadKind {
    /// Features are r, g, b; depth is rendered as the fourth channel.
    Color,
    /// Features are language codes.
    Language,
}

/// The arrays of a map and the number of Gaussians in them.
#[derive(Clone, Copy)]
pub(crate) struct MapSlice<'a> {
    pub(crate) arrays: &'a Arrays,
    /// Number of Gaussians; the arrays may have room for more.
    pub(crate) count: usize,
}

/// All arrays of a map, with room for its capacity at least.
pub struct Arrays {
    /// Centres, one row.
    pub means: Parameters,
    /// Color head.
    pub color: Head,
    /// Language head.
    pub language: Head,
}

/// One array, untyped.
pub(super) struct Array<'a> {
    pub(super) buffer: &'a wgpu::Buffer,
    /// Words per Gaussian.
    pub(super) width: usize,
}

/// What the arrays of a map are made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// Steps of the optimiser, which keeps moments.
    Training,
    /// Pictures alone.
    Drawing,
}

/// Room for some Gaussians.
#[derive(Clone, Copy)]
pub(super) struct Room<'a> {
    pub(super) gpu: &'a Gpu,
    pub(super) capacity: usize,
    pub(super) purpose: Purpose,
}

/// Makes arrays larger, one at a time. If one does not fit, those before it have more room than
/// they need and nothing else has changed.
pub(super) struct Growth<'a> {
    pub(super) gpu: &'a Gpu,
    /// Gaussians to carry over.
    pub(super) len: usize,
    /// Gaussians to make room for.
    pub(super) capacity: usize,
}

/// Bytes per Gaussian of a map's widest array.
pub(super) fn widest_bytes(channels: usize) -> usize {
    rows_for(channels).max(GEOMETRY_ROWS) * size_of::<Row>()
}

/// Bytes of a Gaussian in all arrays together.
pub(super) fn gaussian_bytes(channels: usize) -> usize {
    // The mean, and for each head geometry and a feature; each with two moments. Then the steps of both.
    let rows = 1 + 2 * GEOMETRY_ROWS + 1 + rows_for(channels);
    3 * rows * size_of::<Row>() + 2 * size_of::<u32>()
}

/// Sets rows to zero.
pub(super) fn clear_rows(
    encoder: &mut wgpu::CommandEncoder,
    buffer: &Buffer<Row>,
    start: usize,
    len: usize,
) {
    let bytes = |rows: usize| (rows * size_of::<Row>()) as u64;
    if len > 0 {
        encoder.clear_buffer(buffer, bytes(start), Some(bytes(len)));
    }
}

impl Growth<'_> {
    pub(super) fn grow<T: bytemuck::Pod>(
        &self,
        buffer: &mut Buffer<T>,
        label: &str,
        per_gaussian: usize,
    ) -> Result<(), GpuError> {
        let len = self.capacity * per_gaussian;
        if buffer.len() >= len {
            return Ok(());
        }
        let new = Buffer::new(self.gpu, label, len)?;
        let bytes = (self.len * per_gaussian * size_of::<T>()) as u64;
        if bytes > 0 {
            let mut encoder = self.gpu.device().create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(buffer, 0, &new, 0, bytes);
            self.gpu.queue().submit([encoder.finish()]);
        }
        // The old array's memory is free for the next one only after the copy.
        self.gpu.wait()?;
        *buffer = new;
        Ok(())
    }
}

impl Parameters {
    fn new(room: Room<'_>, label: &str, rows: usize) -> Result<Self, GpuError> {
        let Room { gpu, capacity, purpose } = room;
        let moments = if purpose == Purpose::Training { rows * capacity } else { 0 };
        Ok(Self {
            values: Buffer::new(gpu, label, rows * capacity)?,
            first: Buffer::new(gpu, label, moments)?,
            second: Buffer::new(gpu, label, moments)?,
            rows,
        })
    }

    fn moments(&self) -> impl Iterator<Item = &Buffer<Row>> {
        [&self.first, &self.second].into_iter().filter(|moments| !moments.is_empty())
    }

    /// Writes Gaussians from index `start` on, with moments of zero.
    pub(super) fn write(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        start: usize,
        values: &[Row],
    ) {
        self.values.write(gpu, start * self.rows, values);
        for moments in self.moments() {
            clear_rows(encoder, moments, start * self.rows, values.len());
        }
    }

    fn grow(&mut self, growth: &Growth<'_>, label: &str) -> Result<(), GpuError> {
        growth.grow(&mut self.values, label, self.rows)?;
        for moments in [&mut self.first, &mut self.second] {
            if !moments.is_empty() {
                growth.grow(moments, label, self.rows)?;
            }
        }
        Ok(())
    }
}

impl Head {
    fn new(room: Room<'_>, label: &str, rows: usize) -> Result<Self, GpuError> {
        Ok(Self {
            geometry: Parameters::new(room, label, GEOMETRY_ROWS)?,
            features: Parameters::new(room, label, rows)?,
            steps: Buffer::new(room.gpu, label, room.capacity)?,
        })
    }

    pub(super) fn write(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        start: usize,
        head: &HostHead,
    ) {
        self.geometry.write(gpu, encoder, start, &head.geometry());
        self.features.write(gpu, encoder, start, &pad_rows(&head.features, head.channels));
        self.steps.write(gpu, start, &vec![0; head.rotations.len()]);
    }

    pub(super) fn read(
        &self,
        gpu: &Gpu,
        len: usize,
        channels: usize,
    ) -> Result<HostHead, GpuError> {
        let mut head = HostHead::with_capacity(len, channels);
        let rows = self.geometry.rows;
        self.geometry.values.read_some(gpu, rows * len, rows * READ_GAUSSIANS, |geometry| {
            head.extend_geometry(geometry);
        })?;
        head.features = self.read_features(gpu, len, channels)?;
        Ok(head)
    }

    pub(super) fn read_features(
        &self,
        gpu: &Gpu,
        len: usize,
        channels: usize,
    ) -> Result<Vec<f32>, GpuError> {
        let rows = self.features.rows;
        let mut features = Vec::with_capacity(len * channels);
        self.features.values.read_some(gpu, rows * len, rows * READ_GAUSSIANS, |rows| {
            features.extend(unpad_rows(rows, channels));
        })?;
        Ok(features)
    }

    fn grow(&mut self, growth: &Growth<'_>, label: &str) -> Result<(), GpuError> {
        self.geometry.grow(growth, label)?;
        self.features.grow(growth, label)?;
        growth.grow(&mut self.steps, label, 1)
    }
}

impl HeadKind {
    /// Rows of a feature of this head, for language codes of `channels` values.
    pub fn rows(self, channels: usize) -> usize {
        match self {
            Self::Color => 1,
            Self::Language => rows_for(channels),
        }
    }
}

impl Arrays {
    /// The arrays of one head.
    pub fn head(&self, kind: HeadKind) -> &Head {
        match kind {
            HeadKind::Color => &self.color,
            HeadKind::Language => &self.language,
        }
    }

    pub(super) fn new(room: Room<'_>, channels: usize) -> Result<Self, GpuError> {
        Ok(Self {
            means: Parameters::new(room, "means", 1)?,
            color: Head::new(room, "color head", 1)?,
            language: Head::new(room, "language head", rows_for(channels))?,
        })
    }

    pub(super) fn grow(&mut self, growth: &Growth<'_>) -> Result<(), GpuError> {
        self.means.grow(growth, "means")?;
        self.color.grow(growth, "color head")?;
        self.language.grow(growth, "language head")
    }

    /// Every array, in a fixed order.
    pub(super) fn all(&self) -> Vec<Array<'_>> {
        let (color, language) = (&self.color, &self.language);
        let kinds =
            [&self.means, &color.geometry, &color.features, &language.geometry, &language.features];
        let mut arrays = Vec::new();
        for kind in kinds {
            let width = ROW_WORDS * kind.rows;
            arrays.push(Array { buffer: &kind.values, width });
            arrays.extend(kind.moments().map(|buffer| Array { buffer, width }));
        }
        for buffer in [&color.steps, &language.steps] {
            arrays.push(Array { buffer, width: 1 });
        }
        arrays
    }
}
