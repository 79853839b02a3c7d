//! Compute pipelines.
//!
//! A kernel binds one uniform struct (binding 0) and storage buffers (bindings 1, 2, ...), in the
//! order in which [`Shader::bindings`] lists them.

use crate::device::{Gpu, GpuError};
use crate::shader::compose::{Access, Shader};

/// One compiled entry point.
pub struct Kernel {
    pub(super) pipeline: wgpu::ComputePipeline,
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) bindings: usize,
    pub(super) label: &'static str,
}

impl Kernel {
    /// Compiles a shader.
    ///
    /// # Errors
    /// [`GpuError::Limit`] when the adapter binds too few buffers or has too little workgroup
    /// memory, [`GpuError::Kernel`] when the compiler refuses.
    pub fn new(gpu: &Gpu, shader: &Shader) -> Result<Self, GpuError> {
        let found = gpu.limits().max_storage_buffers_per_shader_stage.into();
        let needed = (shader.bindings.len() + usize::from(gpu.tier().stores_arguments())) as u64;
        if needed > found {
            let limit = "max_storage_buffers_per_shader_stage";
            return Err(GpuError::Limit { limit, found, needed });
        }
        gpu.scoped(
            |device| Self::compile(device, shader, gpu.tier().stores_arguments()),
            |reason| GpuError::Kernel { kernel: shader.label, reason },
        )
    }

    fn compile(device: &wgpu::Device, shader: &Shader, stores_arguments: bool) -> Self {
        let label = Some(shader.label);
        let mut text = shader.compose();
        let mut arguments = wgpu::BufferBindingType::Uniform;
        if stores_arguments {
            text = text.replace("var<uniform>", "var<storage, read>");
            arguments = wgpu::BufferBindingType::Storage { read_only: true };
        }
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label,
            source: wgpu::ShaderSource::Wgsl(text.into()),
        });
        let storage = shader
            .bindings
            .iter()
            .map(|access| wgpu::BufferBindingType::Storage { read_only: *access == Access::Read });
        let entries: Vec<_> = std::iter::once(arguments)
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
        Self { pipeline, layout, bindings: shader.bindings.len(), label: shader.label }
    }
}
