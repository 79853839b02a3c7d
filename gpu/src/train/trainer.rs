//! Training steps: forward pass, loss, backward pass and Adam in one submission.
//!
//! The host does not wait for a step. The report of a step, some hundred bytes, is read when the
//! step after the next is taken, or when the caller asks for it. So the device always has work, and
//! reports still arrive at fixed points of the sequence. If a list of hits overflowed, the device
//! changed nothing: the lists grow, and the step is taken again before the next one.

use std::collections::VecDeque;

use crate::device::{Gpu, GpuError, expect_len};
use crate::map::{Gaussians, HeadKind};
use crate::pass::{Camera, Renderer};
use crate::shader::Recorder;
use crate::shader::layout::HitCount;
use crate::train::adam::LearningRates;
use crate::train::kernels::{StepContext, StepKernels};
use crate::train::loss::LossWeights;
use crate::train::step::{REPORT_BYTES, StepJob, StepReport, TrainingView};
use crate::train::target::ColorTarget;
use crate::train::ties::Ties;

/// Steps whose report may be outstanding after [`Trainer::step`] returns.
const IN_FLIGHT: usize = 2;

/// Takes training steps on a map. Owns a renderer, the losses, the optimiser and the steps in
/// flight.
pub struct Trainer {
    renderer: Renderer,
    kernels: StepKernels,
    in_flight: StepsInFlight,
}

/// Steps that were submitted and not yet confirmed, and steps that must be taken again.
#[derive(Default)]
struct StepsInFlight {
    submitted: VecDeque<Submitted>,
    overflowed: VecDeque<StepJob>,
    spare_buffers: Vec<wgpu::Buffer>,
    last: StepReport,
}

struct Submitted {
    job: StepJob,
    report: wgpu::Buffer,
    submission: wgpu::SubmissionIndex,
}

impl Trainer {
    /// Compiles all kernels for language codes of `language_channels` values.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn new(gpu: &Gpu, language_channels: usize) -> Result<Self, GpuError> {
        Self::with_renderer(Renderer::new(gpu, language_channels)?)
    }

    /// As [`Trainer::new`], with lists for `hits` hits at first.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn with_hit_capacity(gpu: &Gpu, channels: usize, hits: usize) -> Result<Self, GpuError> {
        Self::with_renderer(Renderer::with_hit_capacity(gpu, channels, hits)?)
    }

    fn with_renderer(renderer: Renderer) -> Result<Self, GpuError> {
        let kernels = StepKernels::new(renderer.gpu())?;
        Ok(Self { renderer, kernels, in_flight: StepsInFlight::default() })
    }

    /// The renderer that the steps use. Drawing with it waits for the steps in flight, but does not
    /// repeat a step whose lists overflowed: call [`Trainer::settle`] first for that.
    pub fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// Number of hits that the lists of the color and of the language head hold. Lists that are full
    /// make a step wait, so a trainer goes on exactly like another one only with lists as large.
    pub fn hit_capacities(&self) -> [usize; 2] {
        [HeadKind::Color, HeadKind::Language].map(|head| self.renderer.head(head).hit_capacity())
    }

    /// Makes the lists hold as many hits as those of another trainer, from the next step on.
    pub fn set_hit_capacities(&mut self, hits: [usize; 2]) {
        for (head, hits) in [HeadKind::Color, HeadKind::Language].into_iter().zip(hits) {
            self.renderer.head_mut(head).set_hit_capacity(hits);
        }
    }

    /// Sets which parameters the two heads share, from the next step on.
    pub fn set_ties(&mut self, ties: Ties) {
        self.kernels.ties = ties;
    }

    /// Takes one step on a view: forward pass, loss, backward pass and Adam. An empty map, or a
    /// view without a target, is left as it is. Does not wait for the device.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`] when cameras, targets and map disagree, [`GpuError::BadValue`]
    /// for a camera that cannot be used, [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn step(
        &mut self,
        gaussians: &mut Gaussians,
        view: &TrainingView<'_>,
        weights: &LossWeights,
        rates: &LearningRates,
    ) -> Result<(), GpuError> {
        self.check(gaussians, view)?;
        if gaussians.is_empty() || (view.color.is_none() && view.language.is_none()) {
            self.settle(gaussians)?;
            self.in_flight.last = StepReport::default();
            return Ok(());
        }
        self.submit(gaussians, StepJob::new(view, *weights, Some(*rates)))?;
        while self.in_flight.submitted.len() > IN_FLIGHT {
            self.collect()?;
        }
        self.repeat_overflowed(gaussians)
    }

    /// Measures what a step on this view would find of color and depth, without taking it: the
    /// losses, and the gradients of pose and exposure. Zeros for an empty map. Waits for the
    /// device.
    ///
    /// # Errors
    /// As [`Trainer::step`].
    pub fn look(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
        target: &ColorTarget,
        exposure: [f32; 2],
        weights: &LossWeights,
    ) -> Result<StepReport, GpuError> {
        let view =
            TrainingView { camera, color: Some(target), language: None, exposure, focus: None };
        self.check(gaussians, &view)?;
        self.collect_all(gaussians)?;
        if gaussians.is_empty() {
            return Ok(StepReport::default());
        }
        let weights = LossWeights { isotropic: 0.0, ..*weights };
        self.submit(gaussians, StepJob::new(&view, weights, None))?;
        self.collect()?;
        self.repeat_overflowed(gaussians)?;
        self.renderer.gpu().check()?;
        Ok(self.in_flight.last)
    }

    /// Waits until all steps are taken.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn settle(&mut self, gaussians: &mut Gaussians) -> Result<(), GpuError> {
        self.collect_all(gaussians)?;
        self.renderer.gpu().check()
    }

    /// Waits until all steps are taken and returns the report of the last one; zeros if it did
    /// nothing.
    ///
    /// # Errors
    /// As [`Trainer::settle`].
    pub fn last_report(&mut self, gaussians: &mut Gaussians) -> Result<StepReport, GpuError> {
        self.settle(gaussians)?;
        Ok(self.in_flight.last)
    }

    fn check(&self, gaussians: &Gaussians, view: &TrainingView<'_>) -> Result<(), GpuError> {
        let channels = self.renderer.channels();
        expect_len("language_channels", channels, gaussians.language_channels())?;
        gaussians.check_trainable()?;
        view.check(channels)
    }

    fn collect_all(&mut self, gaussians: &Gaussians) -> Result<(), GpuError> {
        while !self.in_flight.submitted.is_empty() {
            self.collect()?;
            self.repeat_overflowed(gaussians)?;
        }
        Ok(())
    }

    /// Repeats the steps that overflowed their lists. Steps in flight are collected first, since
    /// they may have overflowed too.
    fn repeat_overflowed(&mut self, gaussians: &Gaussians) -> Result<(), GpuError> {
        if self.in_flight.overflowed.is_empty() {
            return Ok(());
        }
        while !self.in_flight.submitted.is_empty() {
            self.collect()?;
        }
        while let Some(job) = self.in_flight.overflowed.pop_front() {
            if !gaussians.is_empty() {
                self.submit(gaussians, job)?;
                self.collect()?;
            }
        }
        Ok(())
    }

    /// Records a step and hands it to the device.
    fn submit(&mut self, gaussians: &Gaussians, job: StepJob) -> Result<(), GpuError> {
        let gpu = self.renderer.gpu().clone();
        let map = gaussians.slice().expect("the map is not empty");
        self.renderer.reserve(gaussians, job.cameras(), true)?;
        self.kernels.reserve(&gpu, gaussians, &job)?;
        let report = match self.in_flight.spare_buffers.pop() {
            Some(buffer) => buffer,
            None => report_buffer(&gpu)?,
        };
        let mut recorder = Recorder::new(&gpu)?;
        let results = &self.kernels.results;
        recorder.clear(results);
        self.kernels.choose(&mut recorder, &self.renderer, &job);
        self.renderer.record_forward(&mut recorder, map, job.cameras());
        let step = StepContext { renderer: &self.renderer, map, job: &job };
        self.kernels.record(&mut recorder, step);
        recorder.copy(results, &report, 0, results.size());
        let used = [job.color.is_some(), job.language.is_some()];
        let bytes = size_of::<HitCount>() as u64;
        for (used, (head, offset)) in used.into_iter().zip(count_offsets(results.size())) {
            if used {
                let count = self.renderer.head(head).hit_count();
                recorder.copy(count, &report, offset, bytes);
            }
        }
        let submission = recorder.submit();
        report.map_async(wgpu::MapMode::Read, .., |_| ());
        self.in_flight.submitted.push_back(Submitted { job, report, submission });
        Ok(())
    }

    /// Waits for the oldest step in flight, keeps its report and grows the lists that overflowed.
    fn collect(&mut self) -> Result<(), GpuError> {
        let Some(oldest) = self.in_flight.submitted.pop_front() else { return Ok(()) };
        self.renderer.gpu().wait_for(oldest.submission)?;
        let bytes = oldest
            .report
            .get_mapped_range(..)
            .map_err(|error| GpuError::DeviceLost(format!("read-back failed: {error}")))?
            .to_vec();
        oldest.report.unmap();
        self.in_flight.spare_buffers.push(oldest.report);
        let (results, counts) = bytes.split_at(self.kernels.results.size() as usize);
        let counts: Vec<HitCount> = bytemuck::pod_collect_to_vec(counts);
        let mut complete = true;
        for (used, head, count) in [
            (oldest.job.color.is_some(), HeadKind::Color, counts[0]),
            (oldest.job.language.is_some(), HeadKind::Language, counts[1]),
        ] {
            complete &= !(used && self.renderer.head_mut(head).grow_after(count));
        }
        if complete {
            self.in_flight.last = StepReport::from_rows(&bytemuck::pod_collect_to_vec(results));
        } else {
            self.in_flight.overflowed.push_back(oldest.job);
        }
        Ok(())
    }
}

/// Where the hit counts of both heads lie in a report, in bytes, behind the results.
fn count_offsets(results: u64) -> [(HeadKind, u64); 2] {
    let bytes = size_of::<HitCount>() as u64;
    [(HeadKind::Color, results), (HeadKind::Language, results + bytes)]
}

fn report_buffer(gpu: &Gpu) -> Result<wgpu::Buffer, GpuError> {
    let descriptor = wgpu::BufferDescriptor {
        label: Some("step report"),
        size: REPORT_BYTES,
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    };
    gpu.scoped(
        |device| device.create_buffer(&descriptor),
        |reason| {
            let label = "step report".to_owned();
            GpuError::OutOfMemory { label, bytes: REPORT_BYTES, reason }
        },
    )
}
