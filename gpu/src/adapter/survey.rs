//! The report on one adapter that `lexsplat-server --adapters` prints.

use crate::device::{Facts, Gpu, GpuError, Tier};

/// One adapter, as [`Gpu::survey`] found it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterReport {
    /// The name that the driver gives the adapter.
    pub name: String,
    /// `discrete`, `integrated`, `virtual`, `other` or `software`.
    pub kind: &'static str,
    /// Name and version of the driver.
    pub driver: String,
    /// `vulkan`.
    pub backend: String,
    /// Largest storage binding, in bytes.
    pub largest_binding: u64,
    /// Workgroup memory, in bytes.
    pub workgroup_memory: u32,
    /// Fewest and most lanes of a subgroup; `None` without subgroup operations.
    pub subgroup: Option<(u32, u32)>,
    /// The tier that a device on this adapter gets; `None` if the adapter cannot be used.
    pub tier: Option<Tier>,
    /// Why the device gets no better tier, or why the adapter cannot be used; `None` if the tier is
    /// the best one.
    pub why_not_better: Option<String>,
}

impl AdapterReport {
    /// Describes an adapter and the result of opening it.
    pub(super) fn new(adapter: &wgpu::Adapter, opened: Result<Gpu, GpuError>) -> Self {
        let (info, limits) = (adapter.get_info(), adapter.limits());
        let facts = Facts::of(adapter);
        let (tier, why_not_better) = match opened {
            Ok(gpu) => {
                let (_, lacks) = facts.tiers();
                (Some(gpu.tier()), gpu.failed_tiers().map(str::to_owned).or(lacks))
            }
            Err(error) => (None, Some(error.to_string())),
        };
        Self {
            name: info.name,
            kind: kind(info.device_type),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            backend: info.backend.to_string(),
            largest_binding: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
            workgroup_memory: limits.max_compute_workgroup_storage_size,
            subgroup: facts.subgroup,
            tier,
            why_not_better,
        }
    }
}

fn kind(kind: wgpu::DeviceType) -> &'static str {
    match kind {
        wgpu::DeviceType::DiscreteGpu => "discrete",
        wgpu::DeviceType::IntegratedGpu => "integrated",
        wgpu::DeviceType::VirtualGpu => "virtual",
        wgpu::DeviceType::Other => "other",
        wgpu::DeviceType::Cpu => "software",
    }
}
