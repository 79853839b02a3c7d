//! Recording of dispatches. WebGPU's limit on the workgroups per axis is handled here only.

use bytemuck::Pod;

use crate::device::{Gpu, GpuError, Stamps};
use crate::shader::kernel::Kernel;
use crate::shader::layout::{GROUP, GROUPS_PER_AXIS};

/// Slots for uniform structs in one submission.
const UNIFORM_SLOTS: u64 = 256;
/// Largest uniform struct, in bytes.
const UNIFORM_BYTES: u64 = 256;

/// How many workgroups a dispatch has.
enum Groups<'a> {
    Known(u32),
    /// Three counts in a buffer, from this byte on.
    InBuffer(&'a wgpu::Buffer, usize),
}

/// Collects dispatches; [`Recorder::submit`] hands them to the device.
pub struct Recorder<'a> {
    gpu: &'a Gpu,
    encoder: wgpu::CommandEncoder,
    pass: Option<wgpu::ComputePass<'static>>,
    uniforms: wgpu::Buffer,
    arguments: Vec<u8>,
    stamps: Option<Stamps>,
}

impl<'a> Recorder<'a> {
    /// An empty recording.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`] when not even the uniforms fit.
    pub fn new(gpu: &'a Gpu) -> Result<Self, GpuError> {
        let uniforms = match gpu.spare_uniforms() {
            Some(buffer) => buffer,
            None => Self::uniforms(gpu)?,
        };
        let encoder = gpu.device().create_command_encoder(&Default::default());
        let stamps = gpu.stamps();
        Ok(Self { gpu, encoder, pass: None, uniforms, arguments: Vec::new(), stamps })
    }

    fn uniforms(gpu: &Gpu) -> Result<wgpu::Buffer, GpuError> {
        let bytes = UNIFORM_SLOTS * UNIFORM_BYTES;
        let descriptor = wgpu::BufferDescriptor {
            label: Some("uniforms"),
            size: bytes,
            usage: wgpu::BufferUsages::UNIFORM
                | wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        };
        gpu.scoped(
            |device| device.create_buffer(&descriptor),
            |reason| GpuError::OutOfMemory { label: "uniforms".to_owned(), bytes, reason },
        )
    }

    /// Runs `kernel` on `groups` workgroups with `arguments` as its uniform and `buffers` as its
    /// storage. No groups, no dispatch.
    pub fn dispatch<A: Pod>(
        &mut self,
        kernel: &Kernel,
        arguments: &A,
        buffers: &[&wgpu::Buffer],
        groups: u32,
    ) {
        self.record(kernel, bytemuck::bytes_of(arguments), buffers, Groups::Known(groups));
    }

    /// As [`Recorder::dispatch`], with the counts of workgroups in a buffer on the device: three
    /// `u32` from `byte` on.
    pub fn dispatch_indirect<A: Pod>(
        &mut self,
        kernel: &Kernel,
        arguments: &A,
        buffers: &[&wgpu::Buffer],
        counts: &wgpu::Buffer,
        byte: usize,
    ) {
        let groups = Groups::InBuffer(counts, byte);
        self.record(kernel, bytemuck::bytes_of(arguments), buffers, groups);
    }

    fn record(
        &mut self,
        kernel: &Kernel,
        arguments: &[u8],
        buffers: &[&wgpu::Buffer],
        groups: Groups<'_>,
    ) {
        assert_eq!(buffers.len(), kernel.bindings, "a kernel takes the buffers that it declares");
        if matches!(groups, Groups::Known(0)) {
            return;
        }
        let bind_group = self.bind(kernel, arguments, buffers);
        let writes = self.stamps.as_mut().and_then(|stamps| stamps.next(kernel.label));
        let encoder = &mut self.encoder;
        if let Some((queries, first)) = writes {
            self.pass = None;
            let descriptor = wgpu::ComputePassDescriptor {
                label: Some(kernel.label),
                timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
                    query_set: queries,
                    beginning_of_pass_write_index: Some(first),
                    end_of_pass_write_index: Some(first + 1),
                }),
            };
            self.pass = Some(encoder.begin_compute_pass(&descriptor).forget_lifetime());
        }
        let pass = self.pass.get_or_insert_with(|| {
            encoder.begin_compute_pass(&Default::default()).forget_lifetime()
        });
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        match groups {
            Groups::Known(groups) => {
                let (x, y) = grid(groups);
                pass.dispatch_workgroups(x, y, 1);
            }
            Groups::InBuffer(counts, byte) => {
                pass.dispatch_workgroups_indirect(counts, byte as u64);
            }
        }
    }

    fn bind(
        &mut self,
        kernel: &Kernel,
        arguments: &[u8],
        buffers: &[&wgpu::Buffer],
    ) -> wgpu::BindGroup {
        let offset = self.place(arguments);
        let uniform = wgpu::BufferBinding {
            buffer: &self.uniforms,
            offset,
            size: std::num::NonZeroU64::new(UNIFORM_BYTES),
        };
        let storage = buffers.iter().map(|buffer| buffer.as_entire_binding());
        let entries: Vec<_> = std::iter::once(wgpu::BindingResource::Buffer(uniform))
            .chain(storage)
            .zip(0..)
            .map(|(resource, binding)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        self.gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &kernel.layout,
            entries: &entries,
        })
    }

    /// As [`Recorder::dispatch`], for at least `threads` threads in workgroups of
    /// [`crate::shader::layout::GROUP`].
    pub fn dispatch_threads<A: Pod>(
        &mut self,
        kernel: &Kernel,
        arguments: &A,
        buffers: &[&wgpu::Buffer],
        threads: usize,
    ) {
        let groups = threads.div_ceil(GROUP as usize);
        self.dispatch(kernel, arguments, buffers, groups as u32);
    }

    /// Sets a buffer to zero.
    pub fn clear(&mut self, buffer: &wgpu::Buffer) {
        self.pass = None;
        self.encoder.clear_buffer(buffer, 0, None);
    }

    /// Copies the first `bytes` bytes, a multiple of four, of one buffer to a place in another.
    pub fn copy(&mut self, from: &wgpu::Buffer, to: &wgpu::Buffer, at: u64, bytes: u64) {
        self.pass = None;
        if bytes > 0 {
            self.encoder.copy_buffer_to_buffer(from, 0, to, at, bytes);
        }
    }

    /// Hands everything recorded so far to the device; does not wait.
    pub fn submit(mut self) -> wgpu::SubmissionIndex {
        let index = self.flush();
        self.gpu.keep_uniforms(self.uniforms);
        index
    }

    /// Hands everything recorded so far to the device, waits for it and returns the first `bytes` bytes of a
    /// buffer, a multiple of four.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn submit_and_read(
        mut self,
        buffer: &wgpu::Buffer,
        bytes: u64,
    ) -> Result<Vec<u8>, GpuError> {
        let staging = self.gpu.staging(bytes)?;
        self.copy(buffer, &staging, 0, bytes);
        let gpu = self.gpu;
        let submission = self.submit();
        staging.map_async(wgpu::MapMode::Read, ..bytes, |_| ());
        gpu.wait_for(submission)?;
        let read = staging
            .get_mapped_range(..bytes)
            .map_err(|error| GpuError::DeviceLost(format!("read-back failed: {error}")))?
            .to_vec();
        staging.unmap();
        gpu.keep_staging(staging);
        Ok(read)
    }

    /// Places `arguments` in the next uniform slot and returns its offset. A full buffer is
    /// submitted first.
    fn place(&mut self, arguments: &[u8]) -> u64 {
        assert!(arguments.len() as u64 <= UNIFORM_BYTES, "uniform struct too large");
        if self.arguments.len() as u64 == UNIFORM_SLOTS * UNIFORM_BYTES {
            self.flush();
        }
        let offset = self.arguments.len() as u64;
        self.arguments.extend_from_slice(arguments);
        self.arguments.resize((offset + UNIFORM_BYTES) as usize, 0);
        offset
    }

    fn flush(&mut self) -> wgpu::SubmissionIndex {
        self.pass = None;
        let empty = self.gpu.device().create_command_encoder(&Default::default());
        let mut encoder = std::mem::replace(&mut self.encoder, empty);
        if let Some(stamps) = self.stamps.take() {
            self.gpu.keep_stamps(stamps, &mut encoder);
            self.stamps = self.gpu.stamps();
        }
        self.gpu.queue().write_buffer(&self.uniforms, 0, &self.arguments);
        let index = self.gpu.queue().submit([encoder.finish()]);
        self.arguments.clear();
        index
    }
}

/// Splits `groups` workgroups over two axes; the kernel's `linear_group` undoes it and may see up
/// to one row too many.
fn grid(groups: u32) -> (u32, u32) {
    let rows = groups.div_ceil(GROUPS_PER_AXIS);
    (groups.div_ceil(rows), rows)
}

#[cfg(test)]
mod tests {
    use super::{GROUPS_PER_AXIS, grid};

    #[test]
    fn a_large_grid_is_split_and_covers_every_group() {
        for groups in [1, 2, 65_535, 65_536, 65_537, 131_071, 10_000_000] {
            let (x, y) = grid(groups);
            assert!(x <= GROUPS_PER_AXIS && y <= GROUPS_PER_AXIS, "{groups}: {x} x {y}");
            assert!(u64::from(x) * u64::from(y) >= u64::from(groups), "{groups}: {x} x {y}");
            assert!(u64::from(x) * u64::from(y) < u64::from(groups + x), "{groups}: {x} x {y}");
        }
    }
}
