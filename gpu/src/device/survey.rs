//! What adapters this machine has and what becomes of each: for a person who wonders which one is
//! used and why. Opens every adapter once; nothing of it is kept.

use super::tier::{Facts, Tier};
use super::{open, ranked_adapters};

/// One adapter, as [`super::Gpu::survey`] found it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterReport {
    /// The name that the driver gives the adapter.
    pub name: String,
    /// discrete, integrated, virtual, other or software.
    pub kind: &'static str,
    /// Name and version of the driver.
    pub driver: String,
    /// vulkan.
    pub backend: String,
    /// Largest storage binding, in bytes.
    pub largest_binding: u64,
    /// Workgroup memory, in bytes.
    pub workgroup_memory: u32,
    /// Fewest and most lanes of a subgroup; none without subgroup operations.
    pub subgroup: Option<(u32, u32)>,
    /// The tier that the adapter gets; none if it cannot be used.
    pub tier: Option<Tier>,
    /// Why it gets no better tier, or none; nothing if it has the best.
    pub why_not_better: Option<String>,
}

/// Reports on every adapter, in the order in which [`super::Gpu::new`] prefers them.
pub(super) fn survey() -> Vec<AdapterReport> {
    ranked_adapters().iter().map(report).collect()
}

fn report(adapter: &wgpu::Adapter) -> AdapterReport {
    let (info, limits) = (adapter.get_info(), adapter.limits());
    let facts = Facts::of(adapter);
    let (tier, why_not_better) = match open(adapter, None, &|_, _| ()) {
        Ok(gpu) => {
            let (_, lacks) = facts.tiers();
            (Some(gpu.tier()), gpu.failed_tiers().map(str::to_owned).or(lacks))
        }
        Err(error) => (None, Some(error.to_string())),
    };
    AdapterReport {
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

fn kind(kind: wgpu::DeviceType) -> &'static str {
    match kind {
        wgpu::DeviceType::DiscreteGpu => "discrete",
        wgpu::DeviceType::IntegratedGpu => "integrated",
        wgpu::DeviceType::VirtualGpu => "virtual",
        wgpu::DeviceType::Other => "other",
        wgpu::DeviceType::Cpu => "software",
    }
}
