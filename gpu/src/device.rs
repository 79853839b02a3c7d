//! The adapter, its device and its queue. Vulkan only; Mesa's llvmpipe is an adapter like any
//! other.
//!
//! Everything that can fail on the device ends as a [`GpuError`], never as a panic: allocations run
//! in error scopes, and what the driver reports late is kept until the next wait.

use std::sync::{Arc, Mutex, PoisonError};

use crate::error::GpuError;
use crate::profile::Profile;
use crate::sort::SortShape;
use crate::tiling::Tiling;

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
    tiling: Tiling,
    sort_shape: SortShape,
    uniforms: Mutex<Vec<wgpu::Buffer>>,
    profile: Profile,
    fault: Arc<Mutex<Option<Fault>>>,
}

#[derive(Clone)]
enum Fault {
    Lost(String),
    Refused(String),
}

impl Gpu {
    /// Opens the adapter whose name contains `adapter` (case is ignored), or the best one there is:
    /// discrete, integrated, virtual, software.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] when none is there or fits, [`GpuError::NoDevice`] when the driver
    /// refuses.
    pub fn new(adapter: Option<&str>) -> Result<Gpu, GpuError> {
        let mut adapters = vulkan_adapters();
        adapters.sort_by_key(|candidate| rank(candidate.get_info().device_type));
        let names: Vec<String> = adapters.iter().map(|a| a.get_info().name).collect();
        let fits = |name: &str| {
            adapter.is_none_or(|wanted| name.to_lowercase().contains(&wanted.to_lowercase()))
        };
        let chosen =
            names.iter().position(|name| fits(name)).ok_or_else(|| GpuError::NoAdapter {
                wanted: adapter.map(|wanted| format!("named {wanted:?} ")).unwrap_or_default(),
                found: names.join(", "),
            })?;
        let (name, adapter) = (names[chosen].clone(), adapters.swap_remove(chosen));
        let limits = adapter.limits();
        let features = adapter.features()
            & (wgpu::Features::SUBGROUP
                | wgpu::Features::TIMESTAMP_QUERY
                | wgpu::Features::TIMESTAMP_QUERY_INSIDE_PASSES);
        let info = adapter.get_info();
        let fixed = info.subgroup_min_size == info.subgroup_max_size
            && features.contains(wgpu::Features::SUBGROUP);
        let tiling = fixed
            .then(|| Tiling::subgroup(info.subgroup_min_size))
            .flatten()
            .unwrap_or(Tiling::PORTABLE);
        let sort_shape = match info.device_type {
            wgpu::DeviceType::Cpu => SortShape::FEW_THREADS,
            _ => SortShape::MANY_THREADS,
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("lexsplat"),
            required_limits: limits.clone(),
            required_features: features,
            ..Default::default()
        }))
        .map_err(|error| GpuError::NoDevice { adapter: name.clone(), reason: error.to_string() })?;
        let fault = watch(&device);
        tracing::info!(adapter = %name, "device opened");
        let inner = Inner {
            name,
            device,
            queue,
            limits,
            tiling,
            sort_shape,
            uniforms: Mutex::default(),
            profile: Profile::default(),
            fault,
        };
        Ok(Gpu { inner: Arc::new(inner) })
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
        self.inner.tiling
    }

    /// How sorts are spread over threads on this adapter.
    pub fn sort_shape(&self) -> SortShape {
        self.inner.sort_shape
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
    use super::Gpu;
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
        let one =
            HostGaussians { means: vec![[0.0, 0.0, 2.0]], colour: head(3), language: head(1) };
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
        renderer.render_colour(&map, &camera).expect("the device is there");
        gpu.device().destroy();
        let lost = |error: GpuError| matches!(error, GpuError::DeviceLost(_));
        assert!(lost(renderer.render_colour(&map, &camera).expect_err("it is gone")));
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
}
