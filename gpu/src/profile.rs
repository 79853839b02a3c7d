//! Where the device's time goes: while a profile is on, every dispatch is a pass of its own between
//! two timestamps. For benchmarks; it costs time itself.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crate::buffer::read_bytes;
use crate::device::Gpu;
use crate::error::GpuError;

/// Timestamps of one submission; WebGPU's limit for a query set is twice this.
const MAX_STAMPS: u32 = 1024;

/// Time that one kernel took on the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KernelTime {
    /// Name of the kernel.
    pub label: &'static str,
    /// Sum over its dispatches.
    pub time: Duration,
    /// Number of dispatches.
    pub dispatches: u32,
}

/// What a profile collected so far.
#[derive(Default)]
pub(crate) struct Profile {
    on: Mutex<Option<Vec<Resolved>>>,
}

/// Ticks of a submission on the device, and whose they are: two per label.
struct Resolved {
    ticks: wgpu::Buffer,
    labels: Vec<&'static str>,
}

/// The timestamps of a recording.
pub(crate) struct Stamps {
    queries: wgpu::QuerySet,
    labels: Vec<&'static str>,
}

impl Stamps {
    pub(crate) fn new(gpu: &Gpu) -> Self {
        let queries = gpu.device().create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("timestamps"),
            ty: wgpu::QueryType::Timestamp,
            count: 2 * MAX_STAMPS,
        });
        Self { queries, labels: Vec::new() }
    }

    /// Where the next dispatch writes; nothing if there are too many.
    pub(crate) fn next(&mut self, label: &'static str) -> Option<(&wgpu::QuerySet, u32)> {
        let first = 2 * self.labels.len() as u32;
        if first >= 2 * MAX_STAMPS {
            return None;
        }
        self.labels.push(label);
        Some((&self.queries, first))
    }

    /// Keeps the ticks for [`Gpu::take_profile`].
    pub(crate) fn resolve(self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder) {
        let count = 2 * self.labels.len() as u32;
        if count == 0 {
            return;
        }
        let ticks = gpu.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("ticks"),
            size: u64::from(count) * 8,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        encoder.resolve_query_set(&self.queries, 0..count, &ticks, 0);
        let mut on = gpu.profile().on.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kept) = on.as_mut() {
            kept.push(Resolved { ticks, labels: self.labels });
        }
    }
}

impl Gpu {
    /// Starts to time every dispatch, if the adapter has timestamps; says whether it has.
    pub fn start_profile(&self) -> bool {
        let can = self.device().features().contains(wgpu::Features::TIMESTAMP_QUERY);
        *self.profile().on.lock().unwrap_or_else(PoisonError::into_inner) = can.then(Vec::new);
        can
    }

    /// Stops timing; waits for the device and returns the time of each kernel, longest first.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn take_profile(&self) -> Result<Vec<KernelTime>, GpuError> {
        let kept = self.profile().on.lock().unwrap_or_else(PoisonError::into_inner).take();
        let nanos = f64::from(self.queue().get_timestamp_period());
        let mut times: BTreeMap<&'static str, (f64, u32)> = BTreeMap::new();
        for resolved in kept.unwrap_or_default() {
            let bytes = read_bytes(self, &[(&resolved.ticks, resolved.ticks.size())])?;
            let ticks: Vec<u64> = bytemuck::pod_collect_to_vec(&bytes);
            for (label, pair) in resolved.labels.iter().zip(ticks.chunks_exact(2)) {
                let time = times.entry(label).or_default();
                time.0 += pair[1].saturating_sub(pair[0]) as f64 * nanos;
                time.1 += 1;
            }
        }
        let mut times: Vec<KernelTime> = times
            .into_iter()
            .map(|(label, (nanos, dispatches))| KernelTime {
                label,
                time: Duration::from_nanos(nanos as u64),
                dispatches,
            })
            .collect();
        times.sort_by_key(|kernel| std::cmp::Reverse(kernel.time));
        Ok(times)
    }

    pub(crate) fn profiling(&self) -> bool {
        self.profile().on.lock().unwrap_or_else(PoisonError::into_inner).is_some()
    }
}
