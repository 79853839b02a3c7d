//! The whole pass: render colour, depth and language, and one training step.
//!
//! A step is forward, loss, backward and Adam in one submission; afterwards a status of a few bytes
//! is read: hit counts and losses. If a list overflowed, the device has changed nothing, the lists
//! grow, and the pass is repeated: there is never a picture or a step from a list that was cut
//! short.

use crate::adam::{Adam, LearningRates, Seen};
use crate::buffer::{Buffer, read_bytes};
use crate::camera::Camera;
use crate::device::Gpu;
use crate::error::{GpuError, expect_len};
use crate::gaussians::{Arrays, Gaussians, MAX_CHANNELS};
use crate::kernel::Recorder;
use crate::layout::{HitCount, PixelState, Row, rows_for};
use crate::loss::{Loss, LossWeights, Losses};
use crate::pass::{Lister, Pass, Training};
use crate::reduce::Reduce;
use crate::target::{ColourTarget, LanguageTarget, unpad_rows};

/// Hits that fit before the first growth.
const FIRST_HIT_CAPACITY: usize = 1 << 16;

/// A rendered view, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green, blue over black; height x width x 3.
    pub rgb: Vec<f32>,
    /// Blended z in metres, not divided by opacity; height x width.
    pub depth: Vec<f32>,
    /// One minus the light that passes; height x width.
    pub opacity: Vec<f32>,
}

/// Rendered language codes, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct LanguageImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Length of a code.
    pub channels: usize,
    /// Blended codes, not divided by opacity; height x width x channels.
    pub codes: Vec<f32>,
    /// One minus the light that passes the language head; height x width.
    pub opacity: Vec<f32>,
}

/// One view to learn from. The language camera has the label map's resolution.
#[derive(Clone, Copy)]
pub struct TrainingView<'a> {
    /// Camera of the colour target.
    pub camera: &'a Camera,
    /// Colour and depth, if they are to be learned.
    pub colour: Option<&'a ColourTarget>,
    /// Codes, if they are to be learned, with their camera.
    pub language: Option<(&'a Camera, &'a LanguageTarget)>,
}

/// Pipelines and scratch buffers for one map or one reader.
pub struct Renderer {
    pub(crate) gpu: Gpu,
    pub(crate) channels: usize,
    pub(crate) lister: Lister,
    pub(crate) colour: Pass,
    pub(crate) language: Pass,
    loss: Loss,
    reduce: Reduce,
    adam: Adam,
    results: Buffer<Row>,
    losses: Losses,
}

impl Renderer {
    /// Compiles all kernels for language codes of `language_channels` values.
    ///
    /// # Errors
    /// [`GpuError::BadValue`] unless there are 1 to [`MAX_CHANNELS`] channels; as
    /// [`crate::kernel::Kernel::new`].
    pub fn new(gpu: &Gpu, language_channels: usize) -> Result<Renderer, GpuError> {
        Self::with_hit_capacity(gpu, language_channels, FIRST_HIT_CAPACITY)
    }

    /// As [`Renderer::new`], with lists for `hits` hits at first.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn with_hit_capacity(gpu: &Gpu, channels: usize, hits: usize) -> Result<Self, GpuError> {
        if !(1..=MAX_CHANNELS).contains(&channels) {
            let found = channels.to_string();
            let (what, expected) = ("language_channels", "1 to 64");
            return Err(GpuError::BadValue { what, expected, found });
        }
        Ok(Self {
            gpu: gpu.clone(),
            channels,
            lister: Lister::new(gpu)?,
            colour: Pass::new(gpu, 1, true, hits.max(1))?,
            language: Pass::new(gpu, rows_for(channels), false, hits.max(1))?,
            loss: Loss::new(gpu)?,
            reduce: Reduce::new(gpu)?,
            adam: Adam::new(gpu)?,
            results: Buffer::new(gpu, "losses", 4)?,
            losses: Losses::default(),
        })
    }

    /// Renders colour, depth and opacity.
    ///
    /// # Errors
    /// [`GpuError::BadValue`] for a camera that cannot be used, [`GpuError::OutOfMemory`],
    /// [`GpuError::DeviceLost`].
    pub fn render_colour(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
    ) -> Result<ColourImage, GpuError> {
        let (rows, opacity) = self.render(gaussians, camera, true)?;
        Ok(ColourImage {
            width: camera.width,
            height: camera.height,
            rgb: rows.iter().flat_map(|row| [row[0], row[1], row[2]]).collect(),
            depth: rows.iter().map(|row| row[3]).collect(),
            opacity,
        })
    }

    /// Renders language codes and their opacity.
    ///
    /// # Errors
    /// As [`Renderer::render_colour`].
    pub fn render_language(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
    ) -> Result<LanguageImage, GpuError> {
        let (rows, opacity) = self.render(gaussians, camera, false)?;
        Ok(LanguageImage {
            width: camera.width,
            height: camera.height,
            channels: self.channels,
            codes: unpad_rows(&rows, self.channels),
            opacity,
        })
    }

    /// Largest blending weight, in [0, 1], that each Gaussian had in the last colour pass; empty if
    /// the map was empty or nothing was rendered.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn blend_weights(&mut self) -> Result<Vec<f32>, GpuError> {
        self.colour.weights(&self.gpu)
    }

    /// Which Gaussians the last colour pass showed: those that gave some pixel any light.
    ///
    /// # Errors
    /// As [`Renderer::blend_weights`].
    pub fn visible(&mut self) -> Result<Vec<bool>, GpuError> {
        Ok(self.blend_weights()?.into_iter().map(|weight| weight > 0.0).collect())
    }

    /// One forward pass, loss, backward pass and Adam step. An empty map, or a view with no target,
    /// is left as it is.
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
        self.losses = Losses::default();
        if gaussians.is_empty() || (view.colour.is_none() && view.language.is_none()) {
            return Ok(());
        }
        while !self.try_step(gaussians, view, weights, rates)? {}
        Ok(())
    }

    /// The loss before the last step; zero if it did nothing.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn last_loss(&mut self) -> Result<Losses, GpuError> {
        self.gpu.check()?;
        Ok(self.losses)
    }

    /// Bytes of the larger scratch buffers on the device.
    pub fn device_bytes(&self) -> u64 {
        self.colour.device_bytes() + self.language.device_bytes()
    }

    fn render(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
        colour: bool,
    ) -> Result<(Vec<Row>, Vec<f32>), GpuError> {
        check_camera(camera)?;
        expect_len("language_channels", self.channels, gaussians.language_channels())?;
        let rows = if colour { 1 } else { rows_for(self.channels) };
        let pixels = camera.pixels();
        let Some(arrays) = gaussians.arrays().filter(|_| !gaussians.is_empty()) else {
            return Ok((vec![[0.0; 4]; rows * pixels], vec![0.0; pixels]));
        };
        let head = if colour { &arrays.colour } else { &arrays.language };
        let pass = if colour { &mut self.colour } else { &mut self.language };
        loop {
            pass.reserve(&self.gpu, &self.lister, (gaussians, camera), false)?;
            let mut recorder = Recorder::new(&self.gpu)?;
            let map = (&arrays.means, head, gaussians.len());
            pass.forward(&self.gpu, &mut recorder, &self.lister, map, camera);
            recorder.submit();
            let (image, states) =
                (rows * pixels * size_of::<Row>(), pixels * size_of::<PixelState>());
            let parts: [(&wgpu::Buffer, u64); 3] = [
                (pass.hit_count(), size_of::<HitCount>() as u64),
                (pass.image(), image as u64),
                (pass.pixels(), states as u64),
            ];
            let bytes = read_bytes(&self.gpu, &parts)?;
            let (count, bytes) = bytes.split_at(size_of::<HitCount>());
            if pass.outgrown(bytemuck::pod_read_unaligned(count)) {
                continue;
            }
            let (image, states) = bytes.split_at(image);
            let states: Vec<PixelState> = bytemuck::pod_collect_to_vec(states);
            let opacity = states.iter().map(|state| 1.0 - state.transmittance).collect();
            return Ok((bytemuck::pod_collect_to_vec(image), opacity));
        }
    }

    /// Records and submits a step, then reads its status; false if it must be repeated.
    fn try_step(
        &mut self,
        gaussians: &Gaussians,
        view: &TrainingView<'_>,
        weights: &LossWeights,
        rates: &LearningRates,
    ) -> Result<bool, GpuError> {
        let gpu = self.gpu.clone();
        let arrays = gaussians.arrays().expect("the map is not empty");
        let count = gaussians.len();
        let mut recorder = Recorder::new(&gpu)?;
        if view.colour.is_some() {
            let map = (gaussians, view.camera);
            self.colour.reserve(&gpu, &self.lister, map, true)?;
        }
        if let Some((camera, _)) = view.language {
            self.language.reserve(&gpu, &self.lister, (gaussians, camera), true)?;
        }
        recorder.clear(&self.results);
        self.record_colour(&mut recorder, (arrays, count), view, weights)?;
        self.record_language(&mut recorder, (arrays, count), view, weights)?;
        self.record_shape(&mut recorder, (arrays, count), view, weights)?;
        self.record_adam(&mut recorder, (arrays, count), view, rates);
        recorder.submit();
        self.finish_step(view)
    }

    fn record_colour(
        &mut self,
        recorder: &mut Recorder<'_>,
        (arrays, count): (&Arrays, usize),
        view: &TrainingView<'_>,
        weights: &LossWeights,
    ) -> Result<(), GpuError> {
        let Some(target) = view.colour else { return Ok(()) };
        let map = (&arrays.means, &arrays.colour, count);
        self.colour.forward(&self.gpu, recorder, &self.lister, map, view.camera);
        let training = self.colour.training();
        let buffers = (self.colour.image(), &training.image_gradients, &training.terms);
        self.loss.colour(recorder, target, weights, buffers);
        let pixels = view.camera.pixels();
        let scratch = self.reduce.scratch(&self.gpu, pixels)?;
        self.reduce.sum(recorder, (&training.terms, pixels), (&self.results, 0), &scratch);
        self.colour.backward(recorder, &arrays.means, &arrays.colour);
        Ok(())
    }

    fn record_language(
        &mut self,
        recorder: &mut Recorder<'_>,
        (arrays, count): (&Arrays, usize),
        view: &TrainingView<'_>,
        weights: &LossWeights,
    ) -> Result<(), GpuError> {
        let Some((camera, target)) = view.language else { return Ok(()) };
        let map = (&arrays.means, &arrays.language, count);
        self.language.forward(&self.gpu, recorder, &self.lister, map, camera);
        let training = self.language.training();
        let buffers = (self.language.image(), &training.image_gradients, &training.terms);
        self.loss.language(recorder, target, weights, buffers);
        let pixels = camera.pixels();
        let scratch = self.reduce.scratch(&self.gpu, pixels)?;
        self.reduce.sum(recorder, (&training.terms, pixels), (&self.results, 1), &scratch);
        self.language.backward(recorder, &arrays.means, &arrays.language);
        Ok(())
    }

    fn record_shape(
        &mut self,
        recorder: &mut Recorder<'_>,
        (arrays, count): (&Arrays, usize),
        view: &TrainingView<'_>,
        weights: &LossWeights,
    ) -> Result<(), GpuError> {
        let scratch = self.reduce.scratch(&self.gpu, count)?;
        let (colour, language) = (&arrays.colour.geometry.values, &arrays.language.geometry.values);
        if view.colour.is_some() && weights.isotropic > 0.0 {
            let training = self.colour.training();
            let outputs = (&training.gradients.geometry, &training.terms);
            self.loss.isotropic(recorder, (weights.isotropic, count), colour, outputs);
            self.reduce.sum(recorder, (&training.terms, count), (&self.results, 2), &scratch);
        }
        if view.language.is_some() && weights.tie > 0.0 {
            let training = self.language.training();
            let outputs = (&training.gradients.geometry, &training.terms);
            self.loss.tie(recorder, (weights.tie, count), (colour, language), outputs);
            self.reduce.sum(recorder, (&training.terms, count), (&self.results, 3), &scratch);
        }
        Ok(())
    }

    fn record_adam(
        &self,
        recorder: &mut Recorder<'_>,
        (arrays, count): (&Arrays, usize),
        view: &TrainingView<'_>,
        rates: &LearningRates,
    ) {
        let colour = view.colour.map(|_| (&self.colour, &arrays.colour, &rates.colour));
        let language = view.language.map(|_| (&self.language, &arrays.language, &rates.language));
        let heads = || colour.iter().chain(&language);
        let mut counts = heads().map(|(pass, ..)| pass.hit_count());
        let Some(first) = counts.next() else { return };
        let counts = [first, counts.next().unwrap_or(first)];
        for (pass, head, head_rates) in heads() {
            let Training { gradients, corrections, .. } = pass.training();
            let seen = Seen { sums: &gradients.sums, steps: &head.steps, corrections, counts };
            self.adam.advance(recorder, seen, count);
            self.adam.update_head(recorder, (head, count), head_rates, gradients, corrections);
        }
        if view.colour.is_some() {
            let Training { mean_gradients, corrections, .. } = self.colour.training();
            let flat = [[rates.mean; 4]; 2];
            self.adam.update(recorder, (&arrays.means, count), flat, mean_gradients, corrections);
        }
    }

    /// Waits for the step, keeps its losses and grows what overflowed; false if something did.
    fn finish_step(&mut self, view: &TrainingView<'_>) -> Result<bool, GpuError> {
        let mut parts: Vec<(&wgpu::Buffer, u64)> = vec![(&self.results, self.results.size())];
        let heads =
            [(view.colour.is_some(), &self.colour), (view.language.is_some(), &self.language)];
        for (_, pass) in heads.iter().filter(|(used, _)| *used) {
            parts.push((pass.hit_count(), size_of::<HitCount>() as u64));
        }
        let bytes = read_bytes(&self.gpu, &parts)?;
        let (results, counts) = bytes.split_at(self.results.size() as usize);
        let results: Vec<Row> = bytemuck::pod_collect_to_vec(results);
        let mut counts = bytemuck::pod_collect_to_vec::<u8, HitCount>(counts).into_iter();
        let mut whole = true;
        for (used, pass) in [
            (view.colour.is_some(), &mut self.colour),
            (view.language.is_some(), &mut self.language),
        ] {
            if let Some(count) = used.then(|| counts.next()).flatten() {
                whole &= !pass.outgrown(count);
            }
        }
        self.losses = Losses {
            colour: results[0][0],
            depth: results[0][1],
            language: results[1][0],
            isotropic: results[2][0],
            tie: results[3][0],
        };
        Ok(whole)
    }

    fn check(&self, gaussians: &Gaussians, view: &TrainingView<'_>) -> Result<(), GpuError> {
        expect_len("language_channels", self.channels, gaussians.language_channels())?;
        if let Some(target) = view.colour {
            check_size(view.camera, target.size())?;
        }
        if let Some((camera, target)) = view.language {
            check_size(camera, target.size())?;
            expect_len("target channels", self.channels, target.inner().channels)?;
        }
        Ok(())
    }
}

fn check_size(camera: &Camera, (width, height): (u32, u32)) -> Result<(), GpuError> {
    check_camera(camera)?;
    expect_len("target width", camera.width as usize, width as usize)?;
    expect_len("target height", camera.height as usize, height as usize)
}

pub(crate) fn check_camera(camera: &Camera) -> Result<(), GpuError> {
    let pose = camera.camera_from_world.to_homogeneous();
    let finite = [camera.cx, camera.cy].iter().chain(pose.iter()).all(|value| value.is_finite());
    let focal = [camera.fx, camera.fy].iter().all(|f| f.is_finite() && *f > 0.0);
    let size = camera.width > 0 && camera.height > 0;
    if finite && focal && size {
        return Ok(());
    }
    let expected = "a finite pose, positive focal lengths and at least one pixel";
    Err(GpuError::BadValue { what: "camera", expected, found: format!("{camera:?}") })
}
