//! Training targets: the images that a rendered view is compared with. Clones share the buffers.

use std::sync::{Arc, OnceLock};

use crate::device::{Buffer, Gpu, GpuError, expect_len};
use crate::map::rows::pad_rows;
use crate::shader::Tiling;
use crate::shader::layout::{HUGE, Row};
use crate::train::texels::{Picture, Texel, Texels, is_measured, texels};

/// Color and depth of one view.
#[derive(Clone)]
pub struct ColorTarget {
    inner: Arc<ColorInner>,
}

pub(crate) struct ColorInner {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) texels: Texels,
    pub(crate) color_pixels: usize,
    pub(crate) depth_pixels: usize,
    /// Error of each tile when a step with a focus last drew it; HUGE before.
    errors: OnceLock<Buffer<f32>>,
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
    /// `None` if the codes are not on the device.
    pub(crate) rows: Option<Buffer<Row>>,
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
        check_sizes(width, height, rgb8, depth_metres)?;
        let texels = texels(rgb8, depth_metres, valid);
        let inner = ColorInner {
            width,
            height,
            color_pixels: texels.iter().filter(|[color, _]| *color != 0).count(),
            depth_pixels: count_measured(depth_metres),
            texels: Texels::resident(gpu, &texels)?,
            errors: OnceLock::new(),
        };
        Ok(Self { inner: Arc::new(inner) })
    }

    /// As [`ColorTarget::new`], but the view is on the device only while a trainer takes steps on it.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`].
    pub fn of_picture(
        width: u32,
        height: u32,
        rgb8: Arc<[u8]>,
        depth_metres: Arc<[f32]>,
    ) -> Result<Self, GpuError> {
        check_sizes(width, height, &rgb8, &depth_metres)?;
        let inner = ColorInner {
            width,
            height,
            color_pixels: depth_metres.len(),
            depth_pixels: count_measured(&depth_metres),
            texels: Texels::of_picture(Picture { rgb8, depth_metres }),
            errors: OnceLock::new(),
        };
        Ok(Self { inner: Arc::new(inner) })
    }

    /// Width and height, in pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.inner.width, self.inner.height]
    }

    /// Bytes on the device, while the view is there.
    pub fn device_bytes(&self) -> u64 {
        let pixels = u64::from(self.inner.width) * u64::from(self.inner.height);
        pixels * size_of::<Texel>() as u64
    }

    /// Whether this is the same target as another.
    pub(crate) fn is(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.inner, &other.inner)
    }

    /// What steps with a [`Focus`](crate::Focus) know of this view: the error of each tile, for
    /// [`ColorTarget::set_tile_errors`] of the same picture. Empty before the first such step.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn tile_errors(&self, gpu: &Gpu) -> Result<Vec<f32>, GpuError> {
        self.inner.errors.get().map_or(Ok(Vec::new()), |errors| errors.read(gpu, errors.len()))
    }

    /// Makes steps go on with the errors that [`ColorTarget::tile_errors`] read, before the first step.
    /// Those of an adapter with other tiles are ignored: the next step measures all tiles.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn set_tile_errors(&self, gpu: &Gpu, errors: &[f32]) -> Result<(), GpuError> {
        if errors.len() == self.tiles(gpu) {
            let errors = Buffer::from_slice(gpu, "tile errors", errors)?;
            let _already_there = self.inner.errors.set(errors);
        }
        Ok(())
    }

    /// Makes room for the errors of tiles.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub(crate) fn reserve_tile_errors(&self, gpu: &Gpu) -> Result<(), GpuError> {
        if self.inner.errors.get().is_none() {
            self.set_tile_errors(gpu, &vec![HUGE; self.tiles(gpu)])?;
        }
        Ok(())
    }

    fn tiles(&self, gpu: &Gpu) -> usize {
        let [columns, rows] = Tiling::of(gpu.tier()).tiles(self.size());
        columns as usize * rows as usize
    }

    /// Error of each tile. Needs [`ColorTarget::reserve_tile_errors`].
    pub(crate) fn errors(&self) -> &Buffer<f32> {
        self.inner.errors.get().expect("reserved for the step")
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
        let rows = Some(Buffer::from_slice(gpu, "language target", &rows)?);
        Ok(Self { inner: Arc::new(LanguageInner { width, height, channels, rows }) })
    }

    /// The place of a code map that is not on the device. Its codes have no channels, so a step on it is
    /// refused.
    pub fn absent(width: u32, height: u32) -> Self {
        Self { inner: Arc::new(LanguageInner { width, height, channels: 0, rows: None }) }
    }

    /// Whether the codes are on the device.
    pub fn is_on_device(&self) -> bool {
        self.inner.rows.is_some()
    }

    /// Width and height, in pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.inner.width, self.inner.height]
    }

    pub(crate) fn inner(&self) -> &LanguageInner {
        &self.inner
    }
}

fn check_sizes(width: u32, height: u32, rgb8: &[u8], depth_metres: &[f32]) -> Result<(), GpuError> {
    let pixels = width as usize * height as usize;
    expect_len("rgb8", 3 * pixels, rgb8.len())?;
    expect_len("depth_metres", pixels, depth_metres.len())
}

fn count_measured(depth_metres: &[f32]) -> usize {
    depth_metres.iter().filter(|depth| is_measured(**depth)).count()
}
