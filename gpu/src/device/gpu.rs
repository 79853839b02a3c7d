//! An opened device: the handle that everything else in this crate works through.
//!
//! Nothing here panics when the device fails. Allocations run inside error scopes and return
//! [`GpuError`]; an error that the driver reports later is kept and returned by the next wait.
//! Choosing an adapter and testing it is in `adapter/`.

use std::sync::{Arc, Mutex, PoisonError};

use crate::device::error::GpuError;
use crate::device::profile::{KernelTime, Profile, Stamps, sum_by_kernel};
use crate::device::tier::Tier;

/// Bytes that are read back at a time. More would take memory twice: on its way, and where it arrives.
const READ_BYTES: u64 = 8 << 20;
/// Bytes of the smallest buffers for reading back, which are kept.
const LEAST_STAGING: u64 = 4096;
/// How many of them are kept.
const MOST_STAGING: usize = 4;

/// A device and its queue. Clones share them.
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
    staging: Mutex<Vec<wgpu::Buffer>>,
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
    /// Asks the adapter for a device with the features of `tier`, and with timestamps where the
    /// adapter has them. The device is not tested yet. `tiers` are all tiers that the adapter
    /// offers; `failed_tiers` says which better ones failed the self-test and why.
    pub(crate) fn request(
        adapter: &wgpu::Adapter,
        tier: Tier,
        tiers: Vec<Tier>,
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
            staging: Mutex::default(),
            profile: Profile::default(),
            fault,
            tier,
            tiers,
            failed_tiers,
        };
        Ok(Gpu { inner: Arc::new(inner) })
    }

    /// The set of GPU features that kernels on this device may use.
    pub fn tier(&self) -> Tier {
        self.inner.tier
    }

    /// The tiers that the adapter offers, best first.
    pub fn tiers(&self) -> &[Tier] {
        &self.inner.tiers
    }

    /// The name that the driver gives the adapter.
    pub fn adapter_name(&self) -> &str {
        &self.inner.name
    }

    /// Which better tiers failed the self-test, and how.
    pub(crate) fn failed_tiers(&self) -> Option<&str> {
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

    /// Starts to time every dispatch. Returns false if the adapter has no timestamps.
    pub fn start_profile(&self) -> bool {
        let can = self.device().features().contains(wgpu::Features::TIMESTAMP_QUERY);
        self.inner.profile.start(can);
        can
    }

    /// Stops timing, waits for the device and returns the time of each kernel, longest first.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn take_profile(&self) -> Result<Vec<KernelTime>, GpuError> {
        let nanos_per_tick = f64::from(self.queue().get_timestamp_period());
        let mut timed = Vec::new();
        for resolved in self.inner.profile.take() {
            let bytes = self.read_bytes(&[(&resolved.ticks, resolved.ticks.size())])?;
            timed.push((resolved.labels, bytemuck::pod_collect_to_vec(&bytes)));
        }
        Ok(sum_by_kernel(&timed, nanos_per_tick))
    }

    /// Timestamps for one recording; none while no profile is taken.
    pub(crate) fn stamps(&self) -> Option<Stamps> {
        self.inner.profile.is_on().then(|| Stamps::new(self.device()))
    }

    /// Keeps the timestamps of a recording for [`Gpu::take_profile`].
    pub(crate) fn keep_stamps(&self, stamps: Stamps, encoder: &mut wgpu::CommandEncoder) {
        stamps.resolve(self.device(), encoder, &self.inner.profile);
    }

    /// A uniform buffer that no recording uses any more, if there is one.
    pub(crate) fn spare_uniforms(&self) -> Option<wgpu::Buffer> {
        self.inner.uniforms.lock().unwrap_or_else(PoisonError::into_inner).pop()
    }

    /// Returns a uniform buffer for reuse, after all commands that read it were submitted.
    pub(crate) fn keep_uniforms(&self, buffer: wgpu::Buffer) {
        self.inner.uniforms.lock().unwrap_or_else(PoisonError::into_inner).push(buffer);
    }

    /// A buffer that the host can read, with room for so many bytes.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub(crate) fn staging(&self, bytes: u64) -> Result<wgpu::Buffer, GpuError> {
        if bytes <= LEAST_STAGING {
            let mut spare = self.inner.staging.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(spare) = spare.pop() {
                return Ok(spare);
            }
        }
        let descriptor = wgpu::BufferDescriptor {
            label: Some("read back"),
            size: bytes.max(LEAST_STAGING),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        };
        self.scoped(
            |device| device.create_buffer(&descriptor),
            |reason| GpuError::OutOfMemory { label: "read back".to_owned(), bytes, reason },
        )
    }

    /// Returns a buffer of [`Gpu::staging`] for reuse, no longer mapped.
    pub(crate) fn keep_staging(&self, buffer: wgpu::Buffer) {
        let mut spare = self.inner.staging.lock().unwrap_or_else(PoisonError::into_inner);
        if spare.len() < MOST_STAGING && buffer.size() <= LEAST_STAGING {
            spare.push(buffer);
        }
    }

    /// Runs `make` and returns its result, or the first error that the device reports while it
    /// runs: the loss of the device, else the driver's message through `refuse`.
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
        // A lost device creates invalid objects without an error. Only polling reports the loss.
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

    /// Frees the memory of objects that were dropped. A buffer with a write that was never submitted stays
    /// until the next submission, which this makes. Waits for it.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn reclaim(&self) -> Result<(), GpuError> {
        self.wait_for(self.inner.queue.submit([]))
    }

    /// Waits until the device has done one submission.
    pub(crate) fn wait_for(&self, submission: wgpu::SubmissionIndex) -> Result<(), GpuError> {
        let wait = wgpu::PollType::Wait { submission_index: Some(submission), timeout: None };
        let polled = self.device().poll(wait);
        self.check()?;
        polled.map(|_| ()).map_err(|error| GpuError::DeviceLost(error.to_string()))
    }

    /// Returns the fault that the driver reported since the device was opened, if any.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        let fault = self.inner.fault.lock().unwrap_or_else(PoisonError::into_inner);
        match fault.clone() {
            None => Ok(()),
            Some(Fault::Lost(reason)) => Err(GpuError::DeviceLost(reason)),
            Some(Fault::Refused(reason)) => Err(GpuError::Validation(reason)),
        }
    }

    /// Waits for the device and reads the first bytes of several buffers, one after the other.
    /// Sizes are multiples of four.
    pub(crate) fn read_bytes(&self, parts: &[(&wgpu::Buffer, u64)]) -> Result<Vec<u8>, GpuError> {
        let total: u64 = parts.iter().map(|(_, bytes)| bytes).sum();
        let mut bytes = Vec::with_capacity(total as usize);
        self.read_pieces(parts, READ_BYTES, |piece| bytes.extend_from_slice(piece))?;
        Ok(bytes)
    }

    /// As [`Gpu::read_bytes`], a few pieces of at most `most` bytes at a time, a multiple of four: what is
    /// read back passes through memory of that size.
    pub(crate) fn read_pieces(
        &self,
        parts: &[(&wgpu::Buffer, u64)],
        most: u64,
        mut take: impl FnMut(&[u8]),
    ) -> Result<(), GpuError> {
        let total: u64 = parts.iter().map(|(_, bytes)| bytes).sum();
        if total == 0 {
            return self.wait();
        }
        let room = total.min(most);
        let staging = self.staging(room)?;
        let pieces = parts.iter().flat_map(|(buffer, bytes)| {
            let starts = (0..*bytes).step_by(most as usize);
            starts.map(move |start| (*buffer, start, (bytes - start).min(most)))
        });
        let mut pieces = pieces.peekable();
        while pieces.peek().is_some() {
            let mut encoder = self.device().create_command_encoder(&Default::default());
            let mut filled = 0;
            while let Some((buffer, start, bytes)) =
                pieces.next_if(|(_, _, bytes)| filled + bytes <= room)
            {
                encoder.copy_buffer_to_buffer(buffer, start, &staging, filled, bytes);
                filled += bytes;
            }
            let submission = self.queue().submit([encoder.finish()]);
            staging.map_async(wgpu::MapMode::Read, ..filled, |_| ());
            self.wait_for(submission)?;
            let view = staging
                .get_mapped_range(..filled)
                .map_err(|error| GpuError::DeviceLost(format!("read-back failed: {error}")))?;
            take(&view);
            drop(view);
            staging.unmap();
        }
        self.keep_staging(staging);
        Ok(())
    }
}

/// Keeps the first fault that the driver reports outside of an error scope. The loss of the device
/// replaces any other fault.
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
