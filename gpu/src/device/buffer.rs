//! Typed buffers: a [`Buffer<T>`] is `len` values of `T` in device memory that kernels read and
//! write.
//!
//! Allocation is checked (limits, error scope); nothing here dispatches.

use std::marker::PhantomData;
use std::ops::Deref;

use bytemuck::Pod;

use crate::device::error::GpuError;
use crate::device::gpu::Gpu;

/// Values that are read back at a time.
const READ_VALUES: usize = 1 << 18;

/// `len` values of `T` on the device; zero when new.
pub struct Buffer<T> {
    raw: wgpu::Buffer,
    len: usize,
    kind: PhantomData<fn() -> T>,
}

impl<T> Deref for Buffer<T> {
    type Target = wgpu::Buffer;

    fn deref(&self) -> &wgpu::Buffer {
        &self.raw
    }
}

impl<T: Pod> Buffer<T> {
    /// Allocates `len` zeros; a buffer of length zero still holds one value, since a binding may
    /// not be empty.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`] when the adapter's limits or its memory do not allow it.
    pub fn new(gpu: &Gpu, label: &str, len: usize) -> Result<Self, GpuError> {
        let bytes = (len.max(1) * size_of::<T>()) as u64;
        let refuse =
            |reason: String| GpuError::OutOfMemory { label: label.to_owned(), bytes, reason };
        let limit = largest_binding(gpu);
        if bytes > limit {
            return Err(refuse(format!("the adapter binds at most {limit} bytes")));
        }
        let descriptor = wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT),
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::INDIRECT
                | wgpu::BufferUsages::COPY_SRC
                | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        };
        let raw = gpu.scoped(|device| device.create_buffer(&descriptor), refuse)?;
        Ok(Self { raw, len, kind: PhantomData })
    }

    /// Allocates and fills a buffer.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn from_slice(gpu: &Gpu, label: &str, values: &[T]) -> Result<Self, GpuError> {
        let buffer = Self::new(gpu, label, values.len())?;
        buffer.write(gpu, 0, values);
        Ok(buffer)
    }

    /// Writes `values` from element `start` on. Must fit.
    pub fn write(&self, gpu: &Gpu, start: usize, values: &[T]) {
        assert!(start + values.len() <= self.len, "write beyond the end of a buffer");
        if !values.is_empty() {
            let offset = (start * size_of::<T>()) as u64;
            gpu.queue().write_buffer(&self.raw, offset, bytemuck::cast_slice(values));
        }
    }

    /// Waits for the device and reads the first `len` values back.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`] when the device is gone.
    pub fn read(&self, gpu: &Gpu, len: usize) -> Result<Vec<T>, GpuError> {
        let mut values = Vec::with_capacity(len);
        self.read_some(gpu, len, READ_VALUES, |some| values.extend_from_slice(some))?;
        Ok(values)
    }

    /// As [`Buffer::read`], at most `most` values at a time.
    ///
    /// # Errors
    /// As [`Buffer::read`].
    pub fn read_some(
        &self,
        gpu: &Gpu,
        len: usize,
        most: usize,
        mut take: impl FnMut(&[T]),
    ) -> Result<(), GpuError> {
        assert!(len <= self.len, "read beyond the end of a buffer");
        let bytes = |values: usize| (values * size_of::<T>()) as u64;
        gpu.read_pieces(&[(&self.raw, bytes(len))], bytes(most), |piece| {
            take(&bytemuck::pod_collect_to_vec(piece));
        })
    }

    /// Most values that a buffer of this adapter can hold.
    pub fn most(gpu: &Gpu) -> usize {
        largest_binding(gpu) as usize / size_of::<T>()
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True if it holds no value.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

/// The largest storage binding, in bytes.
pub fn largest_binding(gpu: &Gpu) -> u64 {
    gpu.limits().max_storage_buffer_binding_size.min(gpu.limits().max_buffer_size)
}
