//! The adapter, its device and its queue. Vulkan only; Mesa's llvmpipe is an adapter like any
//! other.
//!
//! Everything that can fail on the device ends as a [`GpuError`], never as a panic: allocations run
//! in error scopes, and what the driver reports late is kept until the next wait. What a device
//! may be asked to do is its [`Tier`], chosen once when it is opened: facts of the adapter propose,
//! a self-test decides.

use std::sync::{Arc, Mutex, PoisonError};

use crate::error::GpuError;
use crate::profile::Profile;
use crate::sort::SortShape;
use crate::tiling::Tiling;

mod selftest;
mod survey;
mod tier;

pub use selftest::shaders as selftest_shaders;
pub use survey::AdapterReport;
pub use tier::{SOFTWARE_SUBGROUP, Tier};

use tier::Facts;

/// A device and its queue; cloning shares them.
#[derive(Clone)]
pub struct Gpu {
    inner: Arc<Inner>,
}

struct Inner {
    name: String,
    device: wgpu::Device,
    queue: wgpu::Queue,
    limits: wgpu::Limits,
    uniforms: Mutex<Vec<wgpu::Buffer>>,
    profile: Profile,
    fault: Arc<Mutex<Option<Fault>>>,
    tier: Tier,
    tiers: Vec<Tier>,
    failed_tiers: Option<String>,
}

#[derive(Clone)]
enum Fault {
    Lost(String),
    Refused(String),
}

impl Gpu {
    /// Opens the adapter whose name contains `adapter` (case is ignored), or the best one there is:
    /// discrete, integrated, virtual, software. Its tier is the best whose self-test it passes;
    /// `LEXSPLAT_TIER` in the environment names another.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] when none is there or fits, [`GpuError::NoDevice`] when the driver
    /// refuses, [`GpuError::SelfTest`] when it computes wrongly, [`GpuError::BadValue`] for a tier
    /// that the adapter cannot have.
    pub fn new(adapter: Option<&str>) -> Result<Gpu, GpuError> {
        let tier = std::env::var_os("LEXSPLAT_TIER").filter(|tier| !tier.is_empty());
        let tier = tier.map(|tier| tier.to_string_lossy().into_owned());
        open(&find(adapter)?, tier.as_deref(), &|_, _| ())
    }

    /// As [`Gpu::new`], with a tier by name whatever the environment says, and no other.
    ///
    /// # Errors
    /// As [`Gpu::new`].
    pub fn with_tier(adapter: Option<&str>, tier: &str) -> Result<Gpu, GpuError> {
        open(&find(adapter)?, Some(tier), &|_, _| ())
    }

    /// What kernels may rely on.
    pub fn tier(&self) -> Tier {
        self.inner.tier
    }

    /// The tiers that the adapter may have by what it says of itself, best first.
    pub fn tiers(&self) -> &[Tier] {
        &self.inner.tiers
    }

    /// Reports on all Vulkan adapters of this machine, best first; opens each of them.
    pub fn survey() -> Vec<AdapterReport> {
        survey::survey()
    }

    /// The name that the driver gives the adapter.
    pub fn adapter_name(&self) -> &str {
        &self.inner.name
    }

    /// Names of all Vulkan adapters of this machine.
    pub fn adapters() -> Vec<String> {
        vulkan_adapters().iter().map(|adapter| adapter.get_info().name).collect()
    }

    /// How tiles are spread over threads on this adapter.
    pub fn tiling(&self) -> Tiling {
        self.tier().tiling()
    }

    /// How sorts are spread over threads on this adapter.
    pub fn sort_shape(&self) -> SortShape {
        self.inner.tier.sort_shape()
    }

    pub(crate) fn profile(&self) -> &Profile {
        &self.inner.profile
    }

    /// A buffer for uniforms that no recording uses any more.
    pub(crate) fn spare_uniforms(&self) -> Option<wgpu::Buffer> {
        self.inner.uniforms.lock().unwrap_or_else(PoisonError::into_inner).pop()
    }

    /// Gives a buffer for uniforms back, once all that reads it is submitted.
    pub(crate) fn keep_uniforms(&self, buffer: wgpu::Buffer) {
        self.inner.uniforms.lock().unwrap_or_else(PoisonError::into_inner).push(buffer);
    }

    /// Which better tiers failed the self-test, and how.
    fn failed_tiers(&self) -> Option<&str> {
        self.inner.failed_tiers.as_deref()
    }

    pub(crate) fn device(&self) -> &wgpu::Device {
        &self.inner.device
    }

    pub(crate) fn queue(&self) -> &wgpu::Queue {
        &self.inner.queue
    }

    pub(crate) fn limits(&self) -> &wgpu::Limits {
        &self.inner.limits
    }

    /// Runs `make` and returns what it made, or the first error that the device reports about it:
    /// the device's loss, else the driver's words through `refuse`.
    pub(crate) fn scoped<T>(
        &self,
        make: impl FnOnce(&wgpu::Device) -> T,
        refuse: impl FnOnce(String) -> GpuError,
    ) -> Result<T, GpuError> {
        let device = self.device();
        let memory = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let validation = device.push_error_scope(wgpu::ErrorFilter::Validation);
        let made = make(device);
        let refused = pollster::block_on(validation.pop());
        let exhausted = pollster::block_on(memory.pop());
        // A lost device makes dead objects without a word; polling is what brings the news.
        let _ = device.poll(wgpu::PollType::Poll);
        self.check()?;
        refused.or(exhausted).map_or(Ok(made), |error| Err(refuse(error.to_string())))
    }

    /// Waits until the device has done all that was submitted.
    pub(crate) fn wait(&self) -> Result<(), GpuError> {
        let polled = self.device().poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        polled.map(|_| ()).map_err(|error| GpuError::DeviceLost(error.to_string()))
    }

    /// Waits until the device has done a submission.
    pub(crate) fn wait_for(&self, submission: wgpu::SubmissionIndex) -> Result<(), GpuError> {
        let wait = wgpu::PollType::Wait { submission_index: Some(submission), timeout: None };
        let polled = self.device().poll(wait);
        self.check()?;
        polled.map(|_| ()).map_err(|error| GpuError::DeviceLost(error.to_string()))
    }

    /// The fault that the driver reported since the device was opened, if any.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        let fault = self.inner.fault.lock().unwrap_or_else(PoisonError::into_inner);
        match fault.clone() {
            None => Ok(()),
            Some(Fault::Lost(reason)) => Err(GpuError::DeviceLost(reason)),
            Some(Fault::Refused(reason)) => Err(GpuError::Validation(reason)),
        }
    }
}

/// Opens an adapter on the best tier whose self-test it passes, or on the tier `wanted` alone.
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
        // A device of its own for each try: what one driver call spoilt does not spoil the next.
        let gpu = request(adapter, (tier, tiers.clone()), failed_tiers)?;
        let Err(reason) = selftest::run(&gpu, tier, tamper) else {
            tracing::info!(adapter = %gpu.inner.name, tier = tier.name(), "device opened");
            return Ok(gpu);
        };
        let (adapter, tier) = (&gpu.inner.name, tier.name());
        tracing::warn!(%adapter, tier, %reason, "self-test failed, the tier is not used");
        failures.push(format!("{tier} failed its self-test: {reason}"));
    }
    Err(GpuError::SelfTest { adapter: adapter.get_info().name, reason: failures.join("; ") })
}

/// A device with what the tier needs, and timestamps where there are any; nothing is tested.
fn request(
    adapter: &wgpu::Adapter,
    (tier, tiers): (Tier, Vec<Tier>),
    failed_tiers: Option<String>,
) -> Result<Gpu, GpuError> {
    let (name, limits) = (adapter.get_info().name, adapter.limits());
    let timestamps = wgpu::Features::TIMESTAMP_QUERY
        | wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS
        | wgpu::Features::TIMESTAMP_QUERY_INSIDE_PASSES;
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        label: Some("lexsplat"),
        required_features: tier.features() | (adapter.features() & timestamps),
        required_limits: limits.clone(),
        ..Default::default()
    }))
    .map_err(|error| GpuError::NoDevice { adapter: name.clone(), reason: error.to_string() })?;
    let fault = watch(&device);
    let inner = Inner {
        name,
        device,
        queue,
        limits,
        uniforms: Mutex::default(),
        profile: Profile::default(),
        fault,
        tier,
        tiers,
        failed_tiers,
    };
    Ok(Gpu { inner: Arc::new(inner) })
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

/// Keeps the first fault that the driver reports outside of an error scope; the loss of the device
/// outdoes all others.
fn watch(device: &wgpu::Device) -> Arc<Mutex<Option<Fault>>> {
    let fault = Arc::new(Mutex::new(None));
    let keep = |slot: &Mutex<Option<Fault>>, found: Fault| {
        let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        if slot.is_none() || matches!(found, Fault::Lost(_)) {
            *slot = Some(found);
        }
    };
    let slot = fault.clone();
    device.set_device_lost_callback(move |reason, message| {
        keep(&slot, Fault::Lost(format!("{reason:?}: {message}")));
    });
    let slot = fault.clone();
    device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
        keep(&slot, Fault::Refused(error.to_string()));
    }));
    fault
}

#[cfg(test)]
mod tests {
    use super::{Gpu, Tier, find, open};
    use crate::buffer::Buffer;
    use crate::{Camera, Gaussians, GpuError, HostGaussians, HostHead, Renderer};
    use nalgebra::Isometry3;

    #[test]
    fn a_lost_device_is_an_error_and_no_panic() {
        let gpu = Gpu::new(None).expect("these tests need a vulkan adapter");
        let mut renderer = Renderer::new(&gpu, 1).expect("compiles");
        let mut map = Gaussians::new(&gpu, 1);
        let head = |channels| HostHead {
            rotations: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[0.0; 3]],
            opacity_logits: vec![0.0],
            features: vec![1.0; channels],
            channels,
        };
        let one = HostGaussians { means: vec![[0.0, 0.0, 2.0]], color: head(3), language: head(1) };
        map.append(&one).expect("fits");
        let camera = Camera {
            width: 8,
            height: 8,
            fx: 8.0,
            fy: 8.0,
            cx: 3.5,
            cy: 3.5,
            camera_from_world: Isometry3::identity(),
        };
        renderer.render_color(&map, &camera).expect("the device is there");
        gpu.device().destroy();
        let lost = |error: GpuError| matches!(error, GpuError::DeviceLost(_));
        assert!(lost(renderer.render_color(&map, &camera).expect_err("it is gone")));
        assert!(lost(map.to_host().expect_err("it is gone")));
        assert!(lost(map.append(&one).expect_err("it is gone")));
        assert!(lost(Buffer::<u32>::new(&gpu, "late", 8).err().expect("it is gone")));
    }

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
        if honest.tiers().len() > 1 {
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
