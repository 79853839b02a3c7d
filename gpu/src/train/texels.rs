//! The pixels of a color target: on the device while a trainer uses them, and made again from the host's
//! picture when they are used later. All bits are the same each time.

use std::sync::{Arc, Mutex, PoisonError};

use crate::device::{Buffer, Gpu, GpuError};

/// A pixel: r, g, b and whether there is a color (255), a byte each; then the depth's bits, metres, -1 for
/// none.
pub(crate) type Texel = [u32; 2];

/// The pixels of one view.
pub(crate) struct Texels {
    /// What they are made from; `None` if they stay on the device.
    picture: Option<Picture>,
    uploaded: Mutex<Option<Arc<Buffer<Texel>>>>,
}

/// A picture in host memory.
pub(crate) struct Picture {
    /// Height x width x 3.
    pub(crate) rgb8: Arc<[u8]>,
    /// Height x width.
    pub(crate) depth_metres: Arc<[f32]>,
}

impl Texels {
    /// Pixels that stay on the device.
    pub(crate) fn resident(gpu: &Gpu, texels: &[Texel]) -> Result<Self, GpuError> {
        let buffer = Buffer::from_slice(gpu, "color target", texels)?;
        Ok(Self { picture: None, uploaded: Mutex::new(Some(Arc::new(buffer))) })
    }

    /// Pixels that are put on the device by [`Texels::upload`].
    pub(crate) fn of_picture(picture: Picture) -> Self {
        Self { picture: Some(picture), uploaded: Mutex::default() }
    }

    /// The pixels on the device; `None` if they are not there.
    pub(crate) fn buffer(&self) -> Option<Arc<Buffer<Texel>>> {
        self.uploaded.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Whether the pixels stay on the device.
    pub(crate) fn is_resident(&self) -> bool {
        self.picture.is_none()
    }

    /// Takes the pixels from the device; returns the buffer if nothing else has it. Those that stay there do.
    pub(crate) fn release(&self) -> Option<Buffer<Texel>> {
        if self.is_resident() {
            return None;
        }
        let mut uploaded = self.uploaded.lock().unwrap_or_else(PoisonError::into_inner);
        uploaded.take().and_then(Arc::into_inner)
    }

    /// Puts the pixels on the device, into `spare` if it has their size.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub(crate) fn upload(&self, gpu: &Gpu, spare: Option<Buffer<Texel>>) -> Result<(), GpuError> {
        let Some(picture) = &self.picture else { return Ok(()) };
        let texels = texels(&picture.rgb8, &picture.depth_metres, |_| true);
        let buffer = match spare.filter(|spare| spare.len() == texels.len()) {
            // Steps in flight that read it come before the write.
            Some(spare) => {
                spare.write(gpu, 0, &texels);
                spare
            }
            None => Buffer::from_slice(gpu, "color target", &texels)?,
        };
        let mut uploaded = self.uploaded.lock().unwrap_or_else(PoisonError::into_inner);
        *uploaded = Some(Arc::new(buffer));
        Ok(())
    }
}

/// Whether a depth is a measurement.
pub(crate) fn is_measured(depth_metres: f32) -> bool {
    depth_metres > 0.0 && depth_metres.is_finite()
}

/// The pixels of a view, with color only where `valid(pixel)`.
pub(crate) fn texels(
    rgb8: &[u8],
    depth_metres: &[f32],
    valid: impl Fn(usize) -> bool,
) -> Vec<Texel> {
    let pixels = rgb8.chunks_exact(3).zip(depth_metres).enumerate();
    pixels
        .map(|(pixel, (rgb, depth))| {
            let color = if valid(pixel) { [rgb[0], rgb[1], rgb[2], u8::MAX] } else { [0; 4] };
            let depth = if is_measured(*depth) { *depth } else { -1.0 };
            [u32::from_le_bytes(color), depth.to_bits()]
        })
        .collect()
}
