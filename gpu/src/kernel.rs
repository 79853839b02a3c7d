//! Pipelines, bindings and dispatches. The only file that knows WebGPU's grid limit.
//!
//! A kernel binds one uniform struct (binding 0) and storage buffers (bindings 1, 2, ...) in the
//! order of its launcher's arguments. A [`Recorder`] collects dispatches and submits them together.

use bytemuck::Pod;

use crate::device::Gpu;
use crate::error::GpuError;
use crate::shader::{Access, Shader};

/// WebGPU's limit on the workgroups along one axis.
const GROUPS_PER_AXIS: u32 = 65_535;
/// Slots for uniform structs in one submission.
const UNIFORM_SLOTS: u64 = 256;
/// Largest uniform struct, in bytes.
const UNIFORM_BYTES: u64 = 256;

/// One compiled entry point.
pub struct Kernel {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    bindings: usize,
}

impl Kernel {
    /// Compiles a shader.
    ///
    /// # Errors
    /// [`GpuError::Limit`] when the adapter binds too few buffers or has too little workgroup
    /// memory, [`GpuError::Kernel`] when the compiler refuses.
    pub fn new(gpu: &Gpu, shader: &Shader) -> Result<Self, GpuError> {
        let found = gpu.limits().max_storage_buffers_per_shader_stage.into();
        let needed = shader.bindings.len() as u64;
        if needed > found {
            let limit = "max_storage_buffers_per_shader_stage";
            return Err(GpuError::Limit { limit, found, needed });
        }
        gpu.scoped(
            |device| Self::compile(device, shader),
            |reason| GpuError::Kernel { kernel: shader.label, reason },
        )
    }

    fn compile(device: &wgpu::Device, shader: &Shader) -> Self {
        let label = Some(shader.label);
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label,
            source: wgpu::ShaderSource::Wgsl(shader.compose().into()),
        });
        let uniform = wgpu::BufferBindingType::Uniform;
        let storage = shader
            .bindings
            .iter()
            .map(|access| wgpu::BufferBindingType::Storage { read_only: *access == Access::Read });
        let entries: Vec<_> = std::iter::once(uniform)
            .chain(storage)
            .zip(0..)
            .map(|(ty, binding)| wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer {
                    ty,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            })
            .collect();
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label,
            entries: &entries,
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label,
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label,
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some(shader.entry),
            compilation_options: Default::default(),
            cache: None,
        });
        Self { pipeline, layout, bindings: shader.bindings.len() }
    }
}

/// Collects dispatches; [`Recorder::submit`] hands them to the device.
pub struct Recorder<'a> {
    gpu: &'a Gpu,
    encoder: wgpu::CommandEncoder,
    pass: Option<wgpu::ComputePass<'static>>,
    uniforms: wgpu::Buffer,
    arguments: Vec<u8>,
}

impl<'a> Recorder<'a> {
    /// An empty recording.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`] when not even the uniforms fit.
    pub fn new(gpu: &'a Gpu) -> Result<Self, GpuError> {
        let bytes = UNIFORM_SLOTS * UNIFORM_BYTES;
        let descriptor = wgpu::BufferDescriptor {
            label: Some("uniforms"),
            size: bytes,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        };
        let uniforms = gpu.scoped(
            |device| device.create_buffer(&descriptor),
            |reason| GpuError::OutOfMemory { label: "uniforms".to_owned(), bytes, reason },
        )?;
        let encoder = gpu.device().create_command_encoder(&Default::default());
        Ok(Self { gpu, encoder, pass: None, uniforms, arguments: Vec::new() })
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
        assert_eq!(buffers.len(), kernel.bindings, "a kernel takes the buffers that it declares");
        if groups == 0 {
            return;
        }
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
        let bind_group = self.gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &kernel.layout,
            entries: &entries,
        });
        let encoder = &mut self.encoder;
        let pass = self.pass.get_or_insert_with(|| {
            encoder.begin_compute_pass(&Default::default()).forget_lifetime()
        });
        let (x, y) = grid(groups);
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.dispatch_workgroups(x, y, 1);
    }

    /// As [`Recorder::dispatch`], for at least `threads` threads in workgroups of
    /// [`crate::layout::GROUP`].
    pub fn dispatch_threads<A: Pod>(
        &mut self,
        kernel: &Kernel,
        arguments: &A,
        buffers: &[&wgpu::Buffer],
        threads: usize,
    ) {
        let groups = threads.div_ceil(crate::layout::GROUP as usize);
        self.dispatch(kernel, arguments, buffers, groups as u32);
    }

    /// Sets a buffer to zero.
    pub fn clear(&mut self, buffer: &wgpu::Buffer) {
        self.pass = None;
        self.encoder.clear_buffer(buffer, 0, None);
    }

    /// Copies the first `bytes` bytes, a multiple of four, of one buffer to another.
    pub fn copy(&mut self, from: &wgpu::Buffer, to: &wgpu::Buffer, bytes: u64) {
        self.pass = None;
        if bytes > 0 {
            self.encoder.copy_buffer_to_buffer(from, 0, to, 0, bytes);
        }
    }

    /// Hands everything recorded so far to the device; does not wait.
    pub fn submit(mut self) {
        self.flush();
    }

    /// Places `arguments` in the next uniform slot, whose offset it returns; a full buffer is
    /// submitted first.
    fn place<A: Pod>(&mut self, arguments: &A) -> u64 {
        assert!(size_of::<A>() as u64 <= UNIFORM_BYTES, "uniform struct too large");
        if self.arguments.len() as u64 == UNIFORM_SLOTS * UNIFORM_BYTES {
            self.flush();
        }
        let offset = self.arguments.len() as u64;
        self.arguments.extend_from_slice(bytemuck::bytes_of(arguments));
        self.arguments.resize((offset + UNIFORM_BYTES) as usize, 0);
        offset
    }

    fn flush(&mut self) {
        self.pass = None;
        let empty = self.gpu.device().create_command_encoder(&Default::default());
        let encoder = std::mem::replace(&mut self.encoder, empty);
        self.gpu.queue().write_buffer(&self.uniforms, 0, &self.arguments);
        self.gpu.queue().submit([encoder.finish()]);
        self.arguments.clear();
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
