//! A map as bytes: parameters, moments and step counts, to be kept and put back as they were.

use crate::device::{Gpu, GpuError, expect_len};
use crate::map::arrays::{self, Array};
use crate::map::gaussians::{Gaussians, MAX_CHANNELS};

/// Everything that the device holds of a map, in host memory.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SavedGaussians {
    /// Number of Gaussians.
    pub len: usize,
    /// Length of a language code.
    pub channels: usize,
    /// Owner of the Gaussians that are appended next.
    pub owner: u32,
    /// The arrays one after the other, each with `len` Gaussians.
    pub bytes: Vec<u8>,
}

impl SavedGaussians {
    /// Reads a map back. All steps must have been taken.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn of(gaussians: &Gaussians) -> Result<Self, GpuError> {
        let Gaussians { len, channels, owner, .. } = *gaussians;
        let bytes = match gaussians.slice() {
            Some(map) => {
                let arrays = map.arrays.all();
                let parts: Vec<_> = arrays.iter().map(|a| (a.buffer, bytes(a, len))).collect();
                gaussians.gpu.read_bytes(&parts)?
            }
            None => Vec::new(),
        };
        Ok(Self { len, channels, owner, bytes })
    }

    /// Puts the map on a device.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`] if there are not as many bytes as the map has,
    /// [`GpuError::BadValue`], [`GpuError::OutOfMemory`].
    pub fn upload(&self, gpu: &Gpu) -> Result<Gaussians, GpuError> {
        if !(1..=MAX_CHANNELS).contains(&self.channels) {
            let (what, expected) = ("language_channels", "1 to 64");
            return Err(GpuError::BadValue { what, expected, found: self.channels.to_string() });
        }
        let mut gaussians = Gaussians::new(gpu, self.channels);
        gaussians.set_owner(self.owner)?;
        if self.len == 0 {
            expect_len("bytes", 0, self.bytes.len())?;
            return Ok(gaussians);
        }
        // Before memory is taken for a number that may be wrong.
        let total = self.len.saturating_mul(arrays::gaussian_bytes(self.channels));
        expect_len("bytes", total, self.bytes.len())?;
        gaussians.reserve(self.len)?;
        let arrays = gaussians.arrays.as_ref().expect("reserved above").all();
        let mut rest = &self.bytes[..];
        for array in &arrays {
            let (part, behind) = rest.split_at(bytes(array, self.len) as usize);
            gpu.queue().write_buffer(array.buffer, 0, part);
            rest = behind;
        }
        gpu.check()?;
        gaussians.len = self.len;
        Ok(gaussians)
    }
}

/// Bytes of `len` Gaussians in an array.
fn bytes(array: &Array<'_>, len: usize) -> u64 {
    (len * array.width * size_of::<u32>()) as u64
}
