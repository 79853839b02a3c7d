//! One training step: forward, loss, backward and Adam in one submission.
//!
//! The host does not wait for a step. What it reports, some hundred bytes, is read when the step
//! after the next is asked for, or when somebody asks; so the device always has work, and yet
//! everything happens at a fixed place in the sequence. If a list overflowed, the device changed
//! nothing; the lists grow and the step is taken again, before the next one.

use std::collections::VecDeque;

use crate::adam::{Gradients, HeadRates, LearningRates, Seen};
use crate::camera::Camera;
use crate::device::Gpu;
use crate::error::{GpuError, expect_len};
use crate::gaussians::{Arrays, Gaussians, Head};
use crate::kernel::Recorder;
use crate::layout::{HitCount, Row};
use crate::loss::{LossWeights, Losses};
use crate::pass::{Pass, Training};
use crate::project::MOVE_ROWS;
use crate::reduce::Summands;
use crate::render::{Cameras, Renderer, check_camera};
use crate::target::{ColorTarget, LanguageTarget};

/// Steps whose report may be outstanding.
const IN_FLIGHT: usize = 2;
/// Rows of results: color; language; isotropic; tie; dL/drho; dL/dtheta.
pub(crate) const RESULT_ROWS: usize = 6;
/// Bytes of a step's report: results, and the hit counts of both heads.
const REPORT_BYTES: u64 = (RESULT_ROWS * size_of::<Row>() + 2 * size_of::<HitCount>()) as u64;

/// One view to learn from. The language camera has the label map's resolution and the same pose.
#[derive(Clone, Copy)]
pub struct TrainingView<'a> {
    /// Camera of the color target.
    pub camera: &'a Camera,
    /// Color and depth, if they are to be learned.
    pub color: Option<&'a ColorTarget>,
    /// Codes, if they are to be learned, with their camera.
    pub language: Option<(&'a Camera, &'a LanguageTarget)>,
    /// Exposure (a, b): the target shows exp(a) color + b.
    pub exposure: [f32; 2],
}

/// What a step found before it moved anything.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepReport {
    /// Terms of the loss.
    pub losses: Losses,
    /// dL/dtau of the color and depth terms, tau = (rho, theta) being a left perturbation of
    /// `camera_from_world`: per metre and per radian.
    pub pose_gradient: [f32; 6],
    /// dL/d(a, b) of the exposure.
    pub exposure_gradient: [f32; 2],
}

/// The steps whose end is not known yet, and those that must be taken again.
#[derive(Default)]
pub(crate) struct Ledger {
    outstanding: VecDeque<Outstanding>,
    lost: VecDeque<Step>,
    spare: Vec<wgpu::Buffer>,
    last: StepReport,
}

struct Outstanding {
    step: Step,
    report: wgpu::Buffer,
    submission: wgpu::SubmissionIndex,
}

/// A view with all that its step needs, kept until the step is known to have been taken.
#[derive(Clone)]
struct Step {
    camera: Camera,
    color: Option<ColorTarget>,
    language: Option<(Camera, LanguageTarget)>,
    exposure: [f32; 2],
    weights: LossWeights,
    /// `None`: the map stays as it is, only the report is wanted.
    rates: Option<LearningRates>,
}

impl Step {
    fn cameras(&self) -> Cameras<'_> {
        Cameras {
            color: self.color.as_ref().map(|_| &self.camera),
            language: self.language.as_ref().map(|(camera, _)| camera),
        }
    }
}

impl Renderer {
    /// One forward pass, loss, backward pass and Adam step. An empty map, or a view with no target,
    /// is left as it is. Does not wait for the device.
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
            self.ledger.last = StepReport::default();
            return Ok(());
        }
        let step = Step {
            camera: view.camera.clone(),
            color: view.color.cloned(),
            language: view.language.map(|(camera, target)| (camera.clone(), target.clone())),
            exposure: view.exposure,
            weights: *weights,
            rates: Some(*rates),
        };
        self.take(gaussians, step)?;
        while self.ledger.outstanding.len() > IN_FLIGHT {
            self.collect()?;
        }
        self.repeat_lost(gaussians)
    }

    /// What a step on this view would find of color and depth, without taking it: the losses, and the
    /// gradients of pose and exposure. Zeros for an empty map. Waits for the device.
    ///
    /// # Errors
    /// As [`Renderer::step`].
    pub fn look(
        &mut self,
        gaussians: &Gaussians,
        (camera, target): (&Camera, &ColorTarget),
        exposure: [f32; 2],
        weights: &LossWeights,
    ) -> Result<StepReport, GpuError> {
        let view = TrainingView { camera, color: Some(target), language: None, exposure };
        self.check(gaussians, &view)?;
        while !self.ledger.outstanding.is_empty() {
            self.collect()?;
            self.repeat_lost(gaussians)?;
        }
        if gaussians.is_empty() {
            return Ok(StepReport::default());
        }
        let (camera, color) = (camera.clone(), Some(target.clone()));
        let weights = LossWeights { isotropic: 0.0, ..*weights };
        let step = Step { camera, color, language: None, exposure, weights, rates: None };
        self.take(gaussians, step)?;
        self.collect()?;
        self.repeat_lost(gaussians)?;
        self.gpu.check()?;
        Ok(self.ledger.last)
    }

    /// Waits until all steps are taken.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn settle(&mut self, gaussians: &mut Gaussians) -> Result<(), GpuError> {
        while !self.ledger.outstanding.is_empty() {
            self.collect()?;
            self.repeat_lost(gaussians)?;
        }
        self.gpu.check()
    }

    /// Waits until all steps are taken and returns what the last one found; zeros if it did nothing.
    ///
    /// # Errors
    /// As [`Renderer::settle`].
    pub fn last_report(&mut self, gaussians: &mut Gaussians) -> Result<StepReport, GpuError> {
        self.settle(gaussians)?;
        Ok(self.ledger.last)
    }

    /// Takes the steps again that met lists that were too small. Steps that are still outstanding
    /// come first: they may have been lost too.
    fn repeat_lost(&mut self, gaussians: &Gaussians) -> Result<(), GpuError> {
        if self.ledger.lost.is_empty() {
            return Ok(());
        }
        while !self.ledger.outstanding.is_empty() {
            self.collect()?;
        }
        while let Some(step) = self.ledger.lost.pop_front() {
            if !gaussians.is_empty() {
                self.take(gaussians, step)?;
                self.collect()?;
            }
        }
        Ok(())
    }

    /// Records and submits a step.
    fn take(&mut self, gaussians: &Gaussians, step: Step) -> Result<(), GpuError> {
        let gpu = self.gpu.clone();
        let arrays = gaussians.arrays().expect("the map is not empty");
        let count = gaussians.len();
        self.reserve(gaussians, step.cameras(), true)?;
        let report = match self.ledger.spare.pop() {
            Some(buffer) => buffer,
            None => report_buffer(&gpu)?,
        };
        let mut recorder = Recorder::new(&gpu)?;
        recorder.clear(&self.results);
        self.draw(&mut recorder, (arrays, count), step.cameras());
        self.record_color(&mut recorder, (arrays, count), &step);
        self.record_language(&mut recorder, arrays, &step);
        self.record_shape(&mut recorder, (arrays, count), &step);
        if let Some(rates) = &step.rates {
            self.record_adam(&mut recorder, (arrays, count), &step, rates);
        }
        let results = self.results.size();
        recorder.copy(&self.results, (&report, 0), results);
        let counts =
            [(step.color.is_some(), &self.color), (step.language.is_some(), &self.language)];
        for (at, (_, pass)) in counts.iter().enumerate().filter(|(_, (used, _))| *used) {
            let bytes = size_of::<HitCount>() as u64;
            recorder.copy(pass.hit_count(), (&report, results + at as u64 * bytes), bytes);
        }
        let submission = recorder.submit();
        report.map_async(wgpu::MapMode::Read, .., |_| ());
        self.ledger.outstanding.push_back(Outstanding { step, report, submission });
        Ok(())
    }

    /// Waits for the oldest outstanding step, keeps its report and grows what overflowed.
    fn collect(&mut self) -> Result<(), GpuError> {
        let Some(oldest) = self.ledger.outstanding.pop_front() else { return Ok(()) };
        self.gpu.wait_for(oldest.submission)?;
        let bytes = oldest
            .report
            .get_mapped_range(..)
            .map_err(|error| GpuError::DeviceLost(format!("read-back failed: {error}")))?
            .to_vec();
        oldest.report.unmap();
        self.ledger.spare.push(oldest.report);
        let (results, counts) = bytes.split_at(self.results.size() as usize);
        let counts: Vec<HitCount> = bytemuck::pod_collect_to_vec(counts);
        let mut whole = true;
        for (used, pass, count) in [
            (oldest.step.color.is_some(), &mut self.color, counts[0]),
            (oldest.step.language.is_some(), &mut self.language, counts[1]),
        ] {
            whole &= !(used && pass.outgrown(count));
        }
        if whole {
            self.ledger.last = StepReport::new(&bytemuck::pod_collect_to_vec(results));
        } else {
            self.ledger.lost.push_back(oldest.step);
        }
        Ok(())
    }

    fn record_color(
        &mut self,
        recorder: &mut Recorder<'_>,
        (arrays, count): (&Arrays, usize),
        step: &Step,
    ) {
        let Some(target) = &step.color else { return };
        let training = self.color.training();
        let buffers = (self.color.image(), &training.image_gradients, &training.terms);
        self.loss.color(recorder, (target, step.exposure), &step.weights, buffers);
        let (ranks, pixels) = (self.lister.ranks(), step.camera.pixels());
        let terms = Summands { rows: &training.terms, len: pixels, row: (1, 0), limit: None };
        self.reduce.sum(recorder, terms, (&self.results, 0), &training.sums);
        self.color.backward(recorder, ranks, (&arrays.means, &arrays.color));
        for (row, slot) in [(1, 4), (2, 5)] {
            let moves = Summands {
                rows: &training.gradients.moves,
                len: count,
                row: (MOVE_ROWS as u32, row),
                limit: Some(&ranks.visible),
            };
            self.reduce.sum(recorder, moves, (&self.results, slot), &training.sums);
        }
    }

    fn record_language(&mut self, recorder: &mut Recorder<'_>, arrays: &Arrays, step: &Step) {
        let Some((camera, target)) = &step.language else { return };
        let training = self.language.training();
        let buffers = (self.language.image(), &training.image_gradients, &training.terms);
        self.loss.language(recorder, target, &step.weights, buffers);
        let pixels = camera.pixels();
        let terms = Summands { rows: &training.terms, len: pixels, row: (1, 0), limit: None };
        self.reduce.sum(recorder, terms, (&self.results, 1), &training.sums);
        self.language.backward(recorder, self.lister.ranks(), (&arrays.means, &arrays.language));
    }

    fn record_shape(
        &mut self,
        recorder: &mut Recorder<'_>,
        (arrays, count): (&Arrays, usize),
        step: &Step,
    ) {
        let ranks = self.lister.ranks();
        let (color, language) = (&arrays.color.geometry.values, &arrays.language.geometry.values);
        let seen =
            |terms| Summands { rows: terms, len: count, row: (1, 0), limit: Some(&ranks.visible) };
        if step.color.is_some() && step.weights.isotropic > 0.0 {
            let training = self.color.training();
            let outputs = (&training.gradients.geometry, &training.terms);
            let factor = (step.weights.isotropic, count);
            self.loss.isotropic(recorder, factor, (ranks, color), outputs);
            self.reduce.sum(recorder, seen(&training.terms), (&self.results, 2), &training.sums);
        }
        if step.language.is_some() && step.weights.tie > 0.0 && !self.ties.scale {
            let training = self.language.training();
            let outputs = (&training.gradients.geometry, &training.terms);
            let factor = (step.weights.tie, count);
            self.loss.tie(recorder, factor, (ranks, color, language), outputs);
            self.reduce.sum(recorder, seen(&training.terms), (&self.results, 3), &training.sums);
        }
    }

    fn record_adam(
        &self,
        recorder: &mut Recorder<'_>,
        (arrays, count): (&Arrays, usize),
        step: &Step,
        learning: &LearningRates,
    ) {
        let ranks = self.lister.ranks();
        let (color, language) = (step.color.is_some(), step.language.is_some());
        let used = |is_used, pass| if is_used { pass } else { None };
        let counts = [
            used(color, Some(&self.color)).unwrap_or(&self.language).hit_count(),
            used(language, Some(&self.language)).unwrap_or(&self.color).hit_count(),
        ];
        if color && language && !self.ties.is_none() {
            let both = (&self.color.training().gradients, &self.language.training().gradients);
            self.tie.merge(recorder, (self.ties, count), both, ranks);
        }
        let tied = self.ties.rows();
        let free = tied.map(|row| row.map(|tied| 1.0 - tied));
        for (is_used, pass, head, rates) in [
            (color, &self.color, &arrays.color, &learning.color),
            (language, &self.language, &arrays.language, &learning.language),
        ] {
            if !is_used {
                continue;
            }
            let Training { gradients, corrections, .. } = pass.training();
            let sums = (&gradients.sums, gradients.sum_rows);
            self.adam.advance(
                recorder,
                Seen { ranks, sums, counts, count },
                &head.steps,
                corrections,
            );
            let is_language = std::ptr::eq(pass, &self.language);
            let share = if is_language { free } else { [[1.0; 4]; 2] };
            self.update_head(recorder, (head, pass, count), (rates, share));
            if is_language && !color && !self.ties.is_none() {
                // The color head has no gradient of its own in this step: the tied parameters
                // follow the language head's.
                let geometry = scaled(learning.color.geometry(), tied);
                let gradients = geometry_gradients(pass, (self.lister.ranks(), count));
                self.adam.update(recorder, &arrays.color.geometry, geometry, gradients);
            }
        }
        if color {
            let Training { gradients, corrections, .. } = self.color.training();
            let rows = (&gradients.moves, MOVE_ROWS);
            let gradients = Gradients { ranks, rows, corrections, count };
            self.adam.update(recorder, &arrays.means, [[learning.mean; 4]; 2], gradients);
            self.tally.add(recorder, self.color.found(ranks), &arrays.statistics);
        }
        if !self.ties.is_none() {
            let pass = if color { &self.color } else { &self.language };
            let moved = (ranks, &pass.training().corrections);
            let heads = (&arrays.color.geometry.values, &arrays.language.geometry.values);
            self.tie.copy(recorder, (self.ties, count), moved, heads);
        }
    }

    fn update_head(
        &self,
        recorder: &mut Recorder<'_>,
        (head, pass, count): (&Head, &Pass, usize),
        (rates, share): (&HeadRates, [Row; 2]),
    ) {
        let ranks = self.lister.ranks();
        let geometry = scaled(rates.geometry(), share);
        let gradients = geometry_gradients(pass, (ranks, count));
        self.adam.update(recorder, &head.geometry, geometry, gradients);
        let Training { gradients, corrections, .. } = pass.training();
        let rows = (&gradients.features, head.features.rows);
        let gradients = Gradients { ranks, rows, corrections, count };
        self.adam.update(recorder, &head.features, [[rates.feature; 4]; 2], gradients);
    }

    fn check(&self, gaussians: &Gaussians, view: &TrainingView<'_>) -> Result<(), GpuError> {
        expect_len("language_channels", self.channels, gaussians.language_channels())?;
        if let Some(target) = view.color {
            check_size(view.camera, target.size())?;
        }
        if let Some((camera, target)) = view.language {
            check_size(camera, target.size())?;
            expect_len("target channels", self.channels, target.inner().channels)?;
        }
        if !view.exposure.iter().all(|value| value.is_finite()) {
            let found = format!("{:?}", view.exposure);
            return Err(GpuError::BadValue { what: "exposure", expected: "finite numbers", found });
        }
        Ok(())
    }
}

impl StepReport {
    fn new(rows: &[Row]) -> Self {
        let [rho, theta] = [rows[4], rows[5]];
        Self {
            losses: Losses {
                color: rows[0][0],
                depth: rows[0][1],
                language: rows[1][0],
                isotropic: rows[2][0],
                tie: rows[3][0],
            },
            pose_gradient: [rho[0], rho[1], rho[2], theta[0], theta[1], theta[2]],
            exposure_gradient: [rows[0][2], rows[0][3]],
        }
    }
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

fn geometry_gradients<'a>(
    pass: &'a Pass,
    (ranks, count): (&'a crate::order::Ranks, usize),
) -> Gradients<'a> {
    let Training { gradients, corrections, .. } = pass.training();
    Gradients { ranks, rows: (&gradients.geometry, 2), corrections, count }
}

fn scaled(rates: [Row; 2], share: [Row; 2]) -> [Row; 2] {
    std::array::from_fn(|row| std::array::from_fn(|i| rates[row][i] * share[row][i]))
}

fn check_size(camera: &Camera, (width, height): (u32, u32)) -> Result<(), GpuError> {
    check_camera(camera)?;
    expect_len("target width", camera.width as usize, width as usize)?;
    expect_len("target height", camera.height as usize, height as usize)
}
