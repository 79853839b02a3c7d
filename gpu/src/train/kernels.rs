//! The kernels of a training step beyond the splatting pass, and the order in which a step runs
//! them.

use crate::device::{Buffer, Gpu, GpuError};
use crate::map::{Gaussians, HeadKind, MapSlice};
use crate::pass::project::MOVE_ROWS;
use crate::pass::{Camera, HeadPass, Renderer};
use crate::primitives::reduce::{Reduce, ReduceScratch, Summands};
use crate::shader::Recorder;
use crate::shader::layout::Row;
use crate::train::adam::{Adam, LearningRates, ParameterGradients, RowRates, SeenGaussians, Youth};
use crate::train::focus::FocusKernels;
use crate::train::loss::{Loss, LossBuffers, ScaleLoss};
use crate::train::step::{
    COLOR_ROW, ISOTROPIC_ROW, LANGUAGE_ROW, POSE_ROW, RESULT_ROWS, StepJob, TIE_ROW,
};
use crate::train::targets_in_use::TargetsInUse;
use crate::train::ties::{TieKernels, Ties};

/// Loss, sums, optimiser and ties, with their scratch buffers.
pub(super) struct StepKernels {
    loss: Loss,
    reduce: Reduce,
    adam: Adam,
    tie: TieKernels,
    focus: FocusKernels,
    /// Which parameters the heads share.
    pub(super) ties: Ties,
    /// The results of the current step; see [`StepReport`](crate::train::StepReport).
    pub(super) results: Buffer<Row>,
    targets: TargetsInUse,
    color: Option<HeadScratch>,
    language: Option<HeadScratch>,
}

/// Scratch buffers for training one head.
struct HeadScratch {
    /// Terms of the loss, one row per pixel or per visible Gaussian.
    terms: Buffer<Row>,
    sums: ReduceScratch,
    /// Bias corrections of the optimiser, one per visible Gaussian.
    corrections: Buffer<[f32; 2]>,
}

/// A step whose forward pass is recorded.
#[derive(Clone, Copy)]
pub(super) struct StepContext<'a> {
    pub(super) renderer: &'a Renderer,
    pub(super) map: MapSlice<'a>,
    pub(super) job: &'a StepJob,
}

impl StepKernels {
    pub(super) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            loss: Loss::new(gpu)?,
            reduce: Reduce::new(gpu)?,
            adam: Adam::new(gpu)?,
            tie: TieKernels::new(gpu)?,
            focus: FocusKernels::new(gpu)?,
            ties: Ties::default(),
            results: Buffer::new(gpu, "results", RESULT_ROWS)?,
            targets: TargetsInUse::default(),
            color: None,
            language: None,
        })
    }

    /// Makes room for a step, and puts its color target on the device.
    pub(super) fn reserve(
        &mut self,
        gpu: &Gpu,
        gaussians: &Gaussians,
        job: &StepJob,
    ) -> Result<(), GpuError> {
        let (map, cameras) = (gaussians.capacity(), job.cameras());
        let color =
            cameras.color.map(|camera| self.loss.color_terms([camera.width, camera.height]));
        let language = cameras.language.map(Camera::pixels);
        for (terms, slot) in [(color, &mut self.color), (language, &mut self.language)] {
            let Some(terms) = terms else { continue };
            let terms = terms.max(map);
            let fits = |scratch: &HeadScratch| {
                scratch.terms.len() >= terms && scratch.corrections.len() == map
            };
            if !slot.as_ref().is_some_and(fits) {
                *slot = None;
                *slot = Some(HeadScratch {
                    terms: Buffer::new(gpu, "loss terms", terms)?,
                    sums: ReduceScratch::new(gpu, terms)?,
                    corrections: Buffer::new(gpu, "corrections", map)?,
                });
            }
        }
        let Some(target) = &job.color else { return Ok(()) };
        if job.focus.is_some() {
            target.reserve_tile_errors(gpu)?;
        }
        self.targets.bring(gpu, target)
    }

    /// Records which tiles the forward pass leaves out.
    pub(super) fn choose(&self, recorder: &mut Recorder<'_>, renderer: &Renderer, job: &StepJob) {
        if let (Some(target), Some(focus)) = (&job.color, job.focus) {
            let left_out = &renderer.head(HeadKind::Color).projected().left_out;
            self.focus.choose(recorder, target, focus, left_out);
        }
    }

    /// Records everything that follows the forward pass: losses, backward passes and, if the job
    /// has learning rates, the optimiser.
    pub(super) fn record(&self, recorder: &mut Recorder<'_>, step: StepContext<'_>) {
        self.record_color(recorder, step);
        self.record_language(recorder, step);
        self.record_isotropic(recorder, step);
        self.record_tie(recorder, step);
        if let Some(rates) = &step.job.rates {
            self.record_adam(recorder, step, rates);
        }
    }

    fn record_color(&self, recorder: &mut Recorder<'_>, step: StepContext<'_>) {
        let Some(target) = &step.job.color else { return };
        let (pass, scratch) = self.head(step.renderer, HeadKind::Color);
        let backward = pass.backward_buffers();
        let buffers = LossBuffers {
            image: pass.image(),
            gradients: &backward.image_gradients,
            terms: &scratch.terms,
        };
        let left_out = &pass.projected().left_out;
        let (exposure, weights) = (step.job.exposure, &step.job.weights);
        self.loss.color(recorder, target, exposure, weights, left_out, buffers);
        let len = self.loss.color_terms(target.size());
        let terms = Summands { rows: &scratch.terms, len, stride: 1, row: 0, limit: None };
        self.reduce.sum(recorder, terms, &self.results, COLOR_ROW, &scratch.sums);
        let binning = step.renderer.binning();
        pass.backward(recorder, binning, step.map.arrays);
        if step.job.focus.is_some() {
            self.focus.measure(recorder, target, &scratch.terms, pass.hit_count(), left_out);
        }
        for (row, slot) in [(1, POSE_ROW), (2, POSE_ROW + 1)] {
            let moves = Summands {
                rows: &backward.gradients.moves,
                len: step.map.count,
                stride: MOVE_ROWS as u32,
                row,
                limit: Some(&binning.ranks().visible),
            };
            self.reduce.sum(recorder, moves, &self.results, slot, &scratch.sums);
        }
    }

    fn record_language(&self, recorder: &mut Recorder<'_>, step: StepContext<'_>) {
        let Some((camera, target)) = &step.job.language else { return };
        let (pass, scratch) = self.head(step.renderer, HeadKind::Language);
        let buffers = LossBuffers {
            image: pass.image(),
            gradients: &pass.backward_buffers().image_gradients,
            terms: &scratch.terms,
        };
        self.loss.language(recorder, target, &step.job.weights, buffers);
        let len = camera.pixels();
        let terms = Summands { rows: &scratch.terms, len, stride: 1, row: 0, limit: None };
        self.reduce.sum(recorder, terms, &self.results, LANGUAGE_ROW, &scratch.sums);
        pass.backward(recorder, step.renderer.binning(), step.map.arrays);
    }

    fn record_isotropic(&self, recorder: &mut Recorder<'_>, step: StepContext<'_>) {
        let weight = step.job.weights.isotropic;
        if step.job.color.is_none() || weight <= 0.0 {
            return;
        }
        self.loss.isotropic(recorder, self.scale_loss(step, HeadKind::Color, weight));
        self.sum_visible(recorder, step, self.scratch(HeadKind::Color), ISOTROPIC_ROW);
    }

    fn record_tie(&self, recorder: &mut Recorder<'_>, step: StepContext<'_>) {
        let weight = step.job.weights.tie;
        if step.job.language.is_none() || weight <= 0.0 || self.ties.scale {
            return;
        }
        let language = &step.map.arrays.language.geometry.values;
        self.loss.tie(recorder, language, self.scale_loss(step, HeadKind::Language, weight));
        self.sum_visible(recorder, step, self.scratch(HeadKind::Language), TIE_ROW);
    }

    /// The inputs and outputs of a term of the loss on the scales of a head.
    fn scale_loss<'a>(
        &'a self,
        step: StepContext<'a>,
        head: HeadKind,
        weight: f32,
    ) -> ScaleLoss<'a> {
        let (pass, scratch) = self.head(step.renderer, head);
        ScaleLoss {
            weight,
            count: step.map.count,
            ranks: step.renderer.binning().ranks(),
            color: &step.map.arrays.color.geometry.values,
            gradients: &pass.backward_buffers().gradients.geometry,
            terms: &scratch.terms,
        }
    }

    /// Sums one term of the loss over the visible Gaussians.
    fn sum_visible(
        &self,
        recorder: &mut Recorder<'_>,
        step: StepContext<'_>,
        scratch: &HeadScratch,
        row: u32,
    ) {
        let limit = Some(&*step.renderer.binning().ranks().visible);
        let terms =
            Summands { rows: &scratch.terms, len: step.map.count, stride: 1, row: 0, limit };
        self.reduce.sum(recorder, terms, &self.results, row, &scratch.sums);
    }

    fn record_adam(
        &self,
        recorder: &mut Recorder<'_>,
        step: StepContext<'_>,
        rates: &LearningRates,
    ) {
        let (color, language) = (step.job.color.is_some(), step.job.language.is_some());
        let (ranks, count) = (step.renderer.binning().ranks(), step.map.count);
        if color && language && !self.ties.is_none() {
            let gradients = |head| &step.renderer.head(head).backward_buffers().gradients;
            let (color, language) = (gradients(HeadKind::Color), gradients(HeadKind::Language));
            self.tie.merge(recorder, &self.ties.arguments(count), color, language, ranks);
        }
        let tied = self.ties.rows();
        let free = tied.map(|row| row.map(|tied| 1.0 - tied));
        if color {
            self.update_head(recorder, step, HeadKind::Color, rates, [[1.0; 4]; 2]);
        }
        if language {
            self.update_head(recorder, step, HeadKind::Language, rates, free);
        }
        if language && !color && !self.ties.is_none() {
            // The color head has no gradient of its own in this step: the tied parameters follow
            // the gradient of the language head.
            let tied_rates = rates.geometry(HeadKind::Color, tied);
            let gradients = self.geometry_gradients(step, HeadKind::Language);
            self.adam.update(recorder, &step.map.arrays.color.geometry, tied_rates, gradients);
        }
        if color {
            let (pass, scratch) = self.head(step.renderer, HeadKind::Color);
            let rows = (&pass.backward_buffers().gradients.moves, MOVE_ROWS);
            let gradients =
                ParameterGradients { ranks, rows, corrections: &scratch.corrections, count };
            self.adam.update(
                recorder,
                &step.map.arrays.means,
                RowRates::all(rates.mean),
                gradients,
            );
        }
        if !self.ties.is_none() {
            let head = if color { HeadKind::Color } else { HeadKind::Language };
            let (arguments, arrays) = (self.ties.arguments(count), step.map.arrays);
            let corrections = &self.scratch(head).corrections;
            let (color, language) = (&arrays.color.geometry, &arrays.language.geometry);
            let values = (&color.values, &language.values);
            self.tie.copy(recorder, &arguments, ranks, corrections, values.0, values.1);
        }
    }

    /// Counts the step for the Gaussians that the optimiser may move, then moves the geometry, with
    /// rates multiplied by `share`, and the features.
    fn update_head(
        &self,
        recorder: &mut Recorder<'_>,
        step: StepContext<'_>,
        head: HeadKind,
        rates: &LearningRates,
        share: [Row; 2],
    ) {
        let (pass, scratch) = self.head(step.renderer, head);
        let (ranks, count) = (step.renderer.binning().ranks(), step.map.count);
        let arrays = step.map.arrays.head(head);
        let HeadScratch { corrections, .. } = scratch;
        let gradients = &pass.backward_buffers().gradients;
        let counts = hit_counts(step).map(HeadPass::hit_count);
        let seen =
            SeenGaussians { ranks, sums: (&gradients.sums, gradients.sum_rows), counts, count };
        let youth = if head == HeadKind::Color { rates.youth } else { Youth::NONE };
        self.adam.advance(recorder, seen, youth, &arrays.steps, corrections);
        let geometry = self.geometry_gradients(step, head);
        self.adam.update(recorder, &arrays.geometry, rates.geometry(head, share), geometry);
        let rows = (&gradients.features, arrays.features.rows);
        let features = ParameterGradients { ranks, rows, corrections, count };
        self.adam.update(
            recorder,
            &arrays.features,
            RowRates::all(rates.head(head).feature),
            features,
        );
    }

    fn geometry_gradients<'a>(
        &'a self,
        step: StepContext<'a>,
        head: HeadKind,
    ) -> ParameterGradients<'a> {
        let (pass, scratch) = self.head(step.renderer, head);
        ParameterGradients {
            ranks: step.renderer.binning().ranks(),
            rows: (&pass.backward_buffers().gradients.geometry, 2),
            corrections: &scratch.corrections,
            count: step.map.count,
        }
    }

    fn head<'a>(
        &'a self,
        renderer: &'a Renderer,
        head: HeadKind,
    ) -> (&'a HeadPass, &'a HeadScratch) {
        (renderer.head(head), self.scratch(head))
    }

    fn scratch(&self, head: HeadKind) -> &HeadScratch {
        match head {
            HeadKind::Color => self.color.as_ref(),
            HeadKind::Language => self.language.as_ref(),
        }
        .expect("reserved by the caller")
    }
}

/// The heads of a step. A single head is given twice.
fn hit_counts(step: StepContext<'_>) -> [&HeadPass; 2] {
    let color = step.job.color.as_ref().map(|_| step.renderer.head(HeadKind::Color));
    let language = step.job.language.as_ref().map(|_| step.renderer.head(HeadKind::Language));
    let either = color.or(language).expect("a step has a target");
    [color.unwrap_or(either), language.unwrap_or(either)]
}
