//! Training targets on the device: the images that a rendered view is compared with. They are
//! uploaded once per keyframe. Clones share the buffers.

use std::sync::Arc;

use crate::device::{Buffer, Gpu, GpuError, expect_len};
use crate::map::rows::{pad_rows, unpad_rows};
use crate::shader::Tiling;
use crate::shader::layout::{HUGE, Row};

/// Color and depth of one view.
#[derive(Clone)]
pub struct ColorTarget {
    inner: Arc<ColorInner>,
}

pub(crate) struct ColorInner {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// r, g, b and whether there is a color (255), a byte each; then the depth's bits, metres, -1
    /// for none.
    pub(crate) texels: Buffer<[u32; 2]>,
    pub(crate) color_pixels: usize,
    pub(crate) depth_pixels: usize,
    /// Error of each tile when a step last drew it; HUGE before.
    pub(crate) errors: Buffer<f32>,
}

/// Language codes of one view, at label resolution.
#[derive(Clone)]
pub struct LanguageTarget {
    inner: Arc<LanguageInner>,
}

pub(crate) struct LanguageInner {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) channels: usize,
    pub(crate) rows: Buffer<Row>,
}

impl ColorTarget {
    /// Uploads a view: `rgb8` is height x width x 3, `depth_metres` height x width; a depth that is
    /// not finite or not positive is no measurement.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`], [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        width: u32,
        height: u32,
        rgb8: &[u8],
        depth_metres: &[f32],
    ) -> Result<Self, GpuError> {
        Self::masked(gpu, width, height, rgb8, depth_metres, |_| true)
    }

    /// As [`ColorTarget::new`], with color only where `valid(pixel)`; pixels are counted row by
    /// row.
    ///
    /// # Errors
    /// As [`ColorTarget::new`].
    pub fn masked(
        gpu: &Gpu,
        width: u32,
        height: u32,
        rgb8: &[u8],
        depth_metres: &[f32],
        valid: impl Fn(usize) -> bool,
    ) -> Result<Self, GpuError> {
        let pixels = width as usize * height as usize;
        expect_len("rgb8", 3 * pixels, rgb8.len())?;
        expect_len("depth_metres", pixels, depth_metres.len())?;
        let is_measured = |depth: f32| depth > 0.0 && depth.is_finite();
        let texels: Vec<[u32; 2]> = (0..pixels)
            .map(|pixel| {
                let [r, g, b] = [0, 1, 2].map(|channel| rgb8[3 * pixel + channel]);
                let color = if valid(pixel) { [r, g, b, u8::MAX] } else { [0; 4] };
                let depth = depth_metres[pixel];
                let depth = if is_measured(depth) { depth } else { -1.0 };
                [u32::from_le_bytes(color), depth.to_bits()]
            })
            .collect();
        let [columns, rows] = Tiling::of(gpu.tier()).tiles([width, height]);
        let tiles = columns as usize * rows as usize;
        let inner = ColorInner {
            width,
            height,
            color_pixels: texels.iter().filter(|[color, _]| *color != 0).count(),
            depth_pixels: depth_metres.iter().filter(|depth| is_measured(**depth)).count(),
            texels: Buffer::from_slice(gpu, "color target", &texels)?,
            errors: Buffer::from_slice(gpu, "tile errors", &vec![HUGE; tiles])?,
        };
        Ok(Self { inner: Arc::new(inner) })
    }

    /// Width and height, in pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.inner.width, self.inner.height]
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        self.inner.texels.size() + self.inner.errors.size()
    }

    /// What steps with a [`Focus`](crate::Focus) know of this view: the error of each tile, for
    /// [`ColorTarget::set_tile_errors`] of the same picture on the same adapter.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn tile_errors(&self, gpu: &Gpu) -> Result<Vec<f32>, GpuError> {
        self.inner.errors.read(gpu, self.inner.errors.len())
    }

    /// Makes steps go on with the errors that [`ColorTarget::tile_errors`] read. Those of an adapter with
    /// other tiles are ignored: the next step measures all tiles.
    pub fn set_tile_errors(&self, gpu: &Gpu, errors: &[f32]) {
        if errors.len() == self.inner.errors.len() {
            self.inner.errors.write(gpu, 0, errors);
        }
    }

    pub(crate) fn inner(&self) -> &ColorInner {
        &self.inner
    }
}

impl LanguageTarget {
    /// Uploads a code map: `codes` is height x width x channels, all finite.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`], [`GpuError::BadValue`] for a code that is not finite,
    /// [`GpuError::OutOfMemory`].
    pub fn new(
        gpu: &Gpu,
        width: u32,
        height: u32,
        channels: usize,
        codes: &[f32],
    ) -> Result<Self, GpuError> {
        let pixels = width as usize * height as usize;
        expect_len("codes", pixels * channels, codes.len())?;
        if let Some(bad) = codes.iter().position(|code| !code.is_finite()) {
            let found = format!("{} at index {bad}", codes[bad]);
            return Err(GpuError::BadValue { what: "codes", expected: "finite numbers", found });
        }
        let rows = pad_rows(codes, channels);
        let rows = Buffer::from_slice(gpu, "language target", &rows)?;
        Ok(Self { inner: Arc::new(LanguageInner { width, height, channels, rows }) })
    }

    /// Width and height, in pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.inner.width, self.inner.height]
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        self.inner.rows.size()
    }

    /// Reads the codes back, height x width x channels.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<f32>, GpuError> {
        let rows = self.inner.rows.read(gpu, self.inner.rows.len())?;
        Ok(unpad_rows(&rows, self.inner.channels))
    }

    pub(crate) fn inner(&self) -> &LanguageInner {
        &self.inner
    }
}
