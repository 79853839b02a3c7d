//! Choosing and opening an adapter. Vulkan only; Mesa's llvmpipe is an adapter like any other.
//!
//! The adapter's own description proposes tiers. A self-test decides: the device gets the best tier
//! that passes.

use crate::adapter::selftest;
use crate::adapter::survey::AdapterReport;
use crate::device::{Facts, Gpu, GpuError, Tier};

impl Gpu {
    /// Opens the adapter whose name contains `adapter` (case is ignored), or the best one: discrete
    /// before integrated, virtual and software. The device gets the best tier that passes the
    /// self-test, or the tier that `LEXSPLAT_TIER` in the environment names.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] if no adapter matches, [`GpuError::NoDevice`] if the driver refuses,
    /// [`GpuError::SelfTest`] if no tier computes correctly, [`GpuError::BadValue`] for a tier that
    /// the adapter does not offer.
    pub fn new(adapter: Option<&str>) -> Result<Gpu, GpuError> {
        let tier = std::env::var_os("LEXSPLAT_TIER").filter(|tier| !tier.is_empty());
        let tier = tier.map(|tier| tier.to_string_lossy().into_owned());
        open(&find(adapter)?, tier.as_deref(), &|_, _| ())
    }

    /// As [`Gpu::new`], but takes the named tier only and ignores the environment.
    ///
    /// # Errors
    /// As [`Gpu::new`].
    pub fn with_tier(adapter: Option<&str>, tier: &str) -> Result<Gpu, GpuError> {
        open(&find(adapter)?, Some(tier), &|_, _| ())
    }

    /// Reports on all Vulkan adapters of this machine, best first; opens each of them.
    pub fn survey() -> Vec<AdapterReport> {
        ranked_adapters()
            .iter()
            .map(|adapter| AdapterReport::new(adapter, open(adapter, None, &|_, _| ())))
            .collect()
    }

    /// Names of all Vulkan adapters of this machine.
    pub fn adapters() -> Vec<String> {
        vulkan_adapters().iter().map(|adapter| adapter.get_info().name).collect()
    }
}

/// Opens an adapter on the best tier that passes the self-test, or on the tier `wanted` only.
fn open(
    adapter: &wgpu::Adapter,
    wanted: Option<&str>,
    tamper: selftest::Tamper<'_>,
) -> Result<Gpu, GpuError> {
    let (tiers, _) = Facts::of(adapter).tiers();
    let candidates: Vec<Tier> = tiers
        .iter()
        .copied()
        .filter(|tier| wanted.is_none_or(|wanted| tier.name() == wanted))
        .collect();
    if let (Some(wanted), true) = (wanted, candidates.is_empty()) {
        let names: Vec<_> = tiers.iter().map(|tier| tier.name()).collect();
        return Err(GpuError::BadValue {
            what: "tier (LEXSPLAT_TIER)",
            expected: "software, portable or subgroup, as far as the adapter has it",
            found: format!("{wanted:?}; this adapter may have {}", names.join(", ")),
        });
    }
    let mut failures = Vec::new();
    for tier in candidates {
        let failed_tiers = (!failures.is_empty()).then(|| failures.join("; "));
        // A new device for each try, so that a failed driver call does not affect the next one.
        let gpu = Gpu::request(adapter, tier, tiers.clone(), failed_tiers)?;
        let Err(reason) = selftest::run(&gpu, tier, tamper) else {
            tracing::info!(adapter = %gpu.adapter_name(), tier = tier.name(), "device opened");
            return Ok(gpu);
        };
        let (adapter, tier) = (gpu.adapter_name(), tier.name());
        tracing::warn!(%adapter, tier, %reason, "self-test failed, the tier is not used");
        failures.push(format!("{tier} failed its self-test: {reason}"));
    }
    Err(GpuError::SelfTest { adapter: adapter.get_info().name, reason: failures.join("; ") })
}

/// The best adapter whose name contains `wanted`.
fn find(wanted: Option<&str>) -> Result<wgpu::Adapter, GpuError> {
    let mut adapters = ranked_adapters();
    let names: Vec<String> = adapters.iter().map(|a| a.get_info().name).collect();
    let fits = |name: &str| wanted.is_none_or(|w| name.to_lowercase().contains(&w.to_lowercase()));
    let chosen = names.iter().position(|name| fits(name)).ok_or_else(|| GpuError::NoAdapter {
        wanted: wanted.map(|wanted| format!("named {wanted:?} ")).unwrap_or_default(),
        found: names.join(", "),
    })?;
    Ok(adapters.swap_remove(chosen))
}

/// All Vulkan adapters, best first.
fn ranked_adapters() -> Vec<wgpu::Adapter> {
    let mut adapters = vulkan_adapters();
    adapters.sort_by_key(|candidate| rank(candidate.get_info().device_type));
    adapters
}

fn vulkan_adapters() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN))
}

fn rank(kind: wgpu::DeviceType) -> u32 {
    match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

#[cfg(test)]
mod tests {
    use super::{find, open};
    use crate::device::{Buffer, Gpu, GpuError, Tier};

    #[test]
    fn a_buffer_beyond_the_limits_is_refused() {
        let gpu = Gpu::new(None).expect("these tests need a vulkan adapter");
        let error = Buffer::<u32>::new(&gpu, "huge", usize::MAX >> 8).err().expect("too large");
        assert!(matches!(error, GpuError::OutOfMemory { .. }), "{error}");
        Buffer::<u32>::new(&gpu, "small", 8).expect("the device is as it was");
    }

    #[test]
    fn a_failed_check_costs_the_tier_and_says_why() {
        let adapter = find(None).expect("these tests need a vulkan adapter");
        let honest = open(&adapter, None, &|_, _| ()).expect("it computes");
        assert_eq!(honest.tier(), honest.tiers()[0], "{:?}", honest.failed_tiers());
        assert!(honest.failed_tiers().is_none());
        // Without subgroups there is only the portable tier, and nothing to fall from.
        assert!(honest.tiers().len() > 1, "this test needs an adapter with subgroups");
        // One wrong word among the subgroups' results.
        let tamper = |check: &'static str, found: &mut [u32]| {
            if check == "check_subgroups" {
                found[137] ^= 1;
            }
        };
        let fallen = open(&adapter, None, &tamper).expect("portable is left");
        assert_eq!(fallen.tier(), Tier::Portable);
        let why = fallen.failed_tiers().expect("it says why");
        assert!(why.contains(honest.tier().name()) && why.contains("check_subgroups"), "{why}");
        let alone = open(&adapter, Some(honest.tier().name()), &tamper);
        let error = alone.err().expect("a tier that was asked for by name or none");
        assert!(matches!(error, GpuError::SelfTest { .. }), "{error}");
    }

    #[test]
    fn without_a_tier_there_is_no_device() {
        let adapter = find(None).expect("these tests need a vulkan adapter");
        let tamper = |check: &'static str, found: &mut [u32]| {
            if check == "check_memory" {
                found[3] += 1;
            }
        };
        let error = open(&adapter, None, &tamper).err().expect("nothing works");
        assert!(matches!(error, GpuError::SelfTest { .. }), "{error}");
        let said = error.to_string();
        assert!(said.contains("check_memory") && said.contains("portable"), "{said}");
    }

    #[test]
    fn a_tier_that_the_adapter_cannot_have_is_refused() {
        let error = Gpu::with_tier(None, "quantum").err().expect("there is no such tier");
        let said = error.to_string();
        assert!(said.contains("quantum") && said.contains("portable"), "{said}");
        let portable = Gpu::with_tier(None, "portable").expect("every adapter has it");
        assert_eq!(portable.tier(), Tier::Portable);
        assert!(!portable.device().features().contains(wgpu::Features::SUBGROUP));
    }

    #[test]
    fn the_survey_knows_the_adapter_that_is_used() {
        let gpu = Gpu::with_tier(None, "portable").expect("these tests need a vulkan adapter");
        let survey = Gpu::survey();
        let names: Vec<_> = survey.iter().map(|report| report.name.as_str()).collect();
        assert_eq!(names.first(), Some(&gpu.adapter_name()), "the best comes first");
        assert_eq!(names.len(), Gpu::adapters().len());
        for report in &survey {
            assert!(report.largest_binding >= 128 << 20, "{report:?}");
            assert!(report.workgroup_memory >= 16 << 10, "{report:?}");
            let best = matches!(report.tier, Some(Tier::Software | Tier::Subgroup { .. }));
            assert_eq!(best, report.why_not_better.is_none(), "{report:?}");
        }
    }
}
