//! Time per kernel, for benchmarks. While a profile is taken, every dispatch is a compute pass of
//! its own between two timestamps, which costs time itself.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

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

/// The timestamps collected so far; `None` while no profile is taken.
#[derive(Default)]
pub(crate) struct Profile {
    kept: Mutex<Option<Vec<Resolved>>>,
}

/// Timestamps of one submission: two ticks per kernel label.
pub(super) struct Resolved {
    pub(super) ticks: wgpu::Buffer,
    pub(super) labels: Vec<&'static str>,
}

/// The timestamps of a recording.
pub(crate) struct Stamps {
    queries: wgpu::QuerySet,
    labels: Vec<&'static str>,
}

impl Profile {
    /// Starts anew if `can`, else stops.
    pub(super) fn start(&self, can: bool) {
        *self.lock() = can.then(Vec::new);
    }

    /// Stops and returns the timestamps that were kept.
    pub(super) fn take(&self) -> Vec<Resolved> {
        self.lock().take().unwrap_or_default()
    }

    pub(super) fn is_on(&self) -> bool {
        self.lock().is_some()
    }

    fn lock(&self) -> MutexGuard<'_, Option<Vec<Resolved>>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Stamps {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let queries = device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("timestamps"),
            ty: wgpu::QueryType::Timestamp,
            count: 2 * MAX_STAMPS,
        });
        Self { queries, labels: Vec::new() }
    }

    /// The query set and the first of the two queries of the next dispatch; `None` if all are used.
    pub(crate) fn next(&mut self, label: &'static str) -> Option<(&wgpu::QuerySet, u32)> {
        let first = 2 * self.labels.len() as u32;
        if first >= 2 * MAX_STAMPS {
            return None;
        }
        self.labels.push(label);
        Some((&self.queries, first))
    }

    /// Copies the ticks to a buffer that `profile` keeps.
    pub(super) fn resolve(
        self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        profile: &Profile,
    ) {
        let count = 2 * self.labels.len() as u32;
        if count == 0 {
            return;
        }
        let ticks = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("ticks"),
            size: u64::from(count) * 8,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        encoder.resolve_query_set(&self.queries, 0..count, &ticks, 0);
        if let Some(kept) = profile.lock().as_mut() {
            kept.push(Resolved { ticks, labels: self.labels });
        }
    }
}

/// Sums the ticks of each kernel (two per label), longest time first.
pub(super) fn sum_by_kernel(
    timed: &[(Vec<&'static str>, Vec<u64>)],
    nanos_per_tick: f64,
) -> Vec<KernelTime> {
    let mut times: BTreeMap<&'static str, (f64, u32)> = BTreeMap::new();
    for (labels, ticks) in timed {
        for (label, pair) in labels.iter().zip(ticks.chunks_exact(2)) {
            let time = times.entry(label).or_default();
            time.0 += pair[1].saturating_sub(pair[0]) as f64 * nanos_per_tick;
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
    times
}
