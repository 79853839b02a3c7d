//! The pose of a live RGB-D image against a reference, such as the map rendered from a predicted
//! pose. [`Aligner::system`] sums one Gauss-Newton normal system between two [`Level`]s of one
//! size. [`Aligner::align`] loops over levels and steps.
//!
//! With q = T p the point of a live pixel in the reference camera, T = `reference_from_live`:
//!
//! - photometric: r = I_ref(pi(q)) - (exp(a) I_live + b), J = [s, q x s, -exp(a) I_live, -1] with s
//!   = dI_ref/dq. Intensity and its slopes are interpolated between four pixels (these slopes are
//!   smoother than the derivative of the interpolation, which jumps where pi(q) is at the centre of
//!   a pixel, as it is everywhere when T is the identity). Accepted where all four have an
//!   intensity and the point is on the reference's surface. Huber.
//! - geometric: r = n_ref . (q - p_ref), J = [n, q x n, 0, 0], point to plane at the nearest
//!   reference pixel; accepted where the point is on the reference's surface. Huber or Cauchy.
//!
//! On the surface: at most `depth_gate` and [`GATE_SIGMAS`] of the depth's own noise from the plane
//! (p_ref, n_ref), with normals that agree. This leaves out points that are occluded in the
//! reference, and points at an edge of depth, which have no normal and mixed colors. A gate along z
//! would keep both where surfaces are 10 cm apart, and would lose floors seen at a low angle.
//! Between two images that share 70 % it made poses worse by two orders of magnitude
//! (`EXPERIMENTS.md`).
//!
//! [`GATE_SIGMAS`]: crate::shader::layout::GATE_SIGMAS
//!
//! Perturbation T <- Exp(tau) T, tau = [rho, theta] (metres, radians). A term adds
//! `weight rho'(r)/r J J^T` to H, `weight rho'(r) J` to g and `weight rho(r)` to its cost. A
//! thread sums [`SYSTEM_RUN`] pixels, the sums are summed in a fixed order, 56 numbers come back.
//! [`Aligner::systems`] sums the systems of several references in one submission.

use nalgebra::Isometry3;

use crate::device::{Buffer, Gpu, GpuError};
use crate::shader::layout::{
    AlignArguments, ArrayArguments, GROUP, RUN, Row, SYSTEM_ROWS, SYSTEM_RUN,
};
use crate::shader::{Access, Constant, GRID, Kernel, Recorder, Shader};
use crate::track::pyramid::{Level, PACKED, Pyramid};

mod normal_system;
pub mod se3;
mod solve;

pub use normal_system::{Counts, EXPOSURE_LIMIT, NormalSystem, PoseStep, Prior};
pub use solve::{Aligned, Schedule, align};

/// Pose and exposure to be found; by default those of the reference.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Maps points of the live camera, metres, into the reference camera.
    pub reference_from_live: Isometry3<f64>,
    /// (a, b): reference intensity = exp(a) live intensity + b.
    pub exposure: [f64; 2],
}

/// Shape of a robust cost for residuals above its threshold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Robust {
    /// Grows linearly.
    #[default]
    Huber,
    /// Grows logarithmically: outliers lose their pull.
    Cauchy,
}

/// Weights, thresholds and gates of a normal system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlignSettings {
    /// Of the photometric term, 1 / intensity²; 0 switches it off.
    pub photometric_weight: f64,
    /// Residual from which the photometric cost grows linearly; intensity.
    pub photometric_threshold: f64,
    /// Residual above which a pixel is no photometric inlier; intensity.
    pub photometric_agreement: f64,
    /// Of the geometric term, 1 / metres²; 0 switches it off.
    pub geometric_weight: f64,
    /// Standard deviation of a depth of one metre, metres. It grows with the depth squared, as
    /// structured light and stereo measure, and lowers the weight of a point:
    /// 1 / (1 / geometric_weight + (depth_noise z²)²).
    pub depth_noise: f64,
    /// Residual from which the geometric cost grows slowly; metres.
    pub geometric_threshold: f64,
    /// Residual above which a pixel is no geometric inlier; metres.
    pub geometric_agreement: f64,
    /// How slowly.
    pub geometric_robust: Robust,
    /// Points farther than this from the plane of the reference's surface are another surface;
    /// metres, beside [`GATE_SIGMAS`](crate::shader::layout::GATE_SIGMAS) of `depth_noise`.
    /// [`AlignSettings::at_level`] quadruples it with each coarser level.
    pub depth_gate: f64,
    /// Normals with a smaller cosine between them are of another surface. With a gate above 0 the
    /// live pixel must have a normal; a gate of -1 looks at the reference's alone.
    pub normal_gate: f64,
    /// On the finest level one of every `stride` live pixels is used; see [`AlignSettings::at_level`].
    pub stride: u32,
}

impl Default for AlignSettings {
    /// Weights of an intensity known to 0.03 and a surface known to 1 cm.
    fn default() -> Self {
        Self {
            photometric_weight: 1e3,
            photometric_threshold: 0.02,
            photometric_agreement: 0.05,
            geometric_weight: 1e4,
            depth_noise: 0.0,
            geometric_threshold: 0.005,
            geometric_agreement: 0.02,
            geometric_robust: Robust::Huber,
            depth_gate: 0.02,
            normal_gate: 0.5,
            stride: 1,
        }
    }
}

/// A live level and the reference level that it is compared with.
#[derive(Clone, Copy)]
pub struct Comparison<'a> {
    /// What the live level is compared with.
    pub reference: &'a Level,
    /// The level whose pixels are counted.
    pub live: &'a Level,
    /// Where the live level was taken, seen from the reference.
    pub estimate: Estimate,
}

/// The kernels and their scratch.
pub struct Aligner {
    gpu: Gpu,
    huber: Kernel,
    cauchy: Kernel,
    sum: Kernel,
    partials: [Buffer<Row>; 2],
}

/// This kernel's shaders.
pub fn shaders() -> [Shader; 3] {
    use Access::{Read, Write};
    let system = |label, cauchy| Shader {
        label,
        entry: "main",
        parts: vec![GRID, PACKED, include_str!("system.wgsl")],
        constants: vec![("CAUCHY", Constant::Bool(cauchy)), ("ROWS", Constant::U32(SYSTEM_ROWS))],
        bindings: vec![Read, Read, Read, Read, Write],
    };
    let sum = Shader {
        label: "align_sum",
        entry: "main",
        parts: vec![GRID, include_str!("sum.wgsl")],
        constants: Vec::new(),
        bindings: vec![Read, Write],
    };
    [system("align_huber", false), system("align_cauchy", true), sum]
}

impl Aligner {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [huber, cauchy, sum] = shaders();
        let empty = || Buffer::new(gpu, "normal systems", 0);
        Ok(Self {
            gpu: gpu.clone(),
            huber: Kernel::new(gpu, &huber)?,
            cauchy: Kernel::new(gpu, &cauchy)?,
            sum: Kernel::new(gpu, &sum)?,
            partials: [empty()?, empty()?],
        })
    }

    /// The normal system of a live level against a reference level at an estimate.
    ///
    /// # Errors
    /// [`GpuError::BadValue`] for an estimate that is not finite or settings that cannot be used,
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn system(
        &mut self,
        reference: &Level,
        live: &Level,
        estimate: &Estimate,
        settings: &AlignSettings,
    ) -> Result<NormalSystem, GpuError> {
        let comparison = Comparison { reference, live, estimate: *estimate };
        let mut systems = self.systems(&[comparison], settings)?;
        Ok(systems.pop().expect("one comparison has one system"))
    }

    /// The normal systems of several comparisons, in one submission. Comparison i of n looks at
    /// pixels that are i / n of a stride further on, so that together they look at more pixels.
    ///
    /// # Errors
    /// As [`Aligner::system`].
    pub fn systems(
        &mut self,
        comparisons: &[Comparison<'_>],
        settings: &AlignSettings,
    ) -> Result<Vec<NormalSystem>, GpuError> {
        settings.check()?;
        comparisons.iter().try_for_each(|comparison| comparison.estimate.check())?;
        let elements = |of: &Comparison<'_>| of.live.camera.pixels() as u32 / settings.stride;
        let most = comparisons.iter().map(elements).max().unwrap_or(0);
        let groups = most.div_ceil(GROUP * SYSTEM_RUN).max(1);
        let count = comparisons.len() as u32;
        self.reserve((count * groups * GROUP) as usize)?;
        let kernel = match settings.geometric_robust {
            Robust::Huber => &self.huber,
            Robust::Cauchy => &self.cauchy,
        };
        let mut recorder = Recorder::new(&self.gpu)?;
        for (comparison, at) in comparisons.iter().zip(0..) {
            let Comparison { reference, live, .. } = comparison;
            let phase = f64::from(at) / f64::from(count);
            let arguments = AlignArguments {
                groups,
                first_group: at * groups,
                ..arguments(comparison, settings, phase)
            };
            let buffers: [&wgpu::Buffer; 5] = [
                &reference.colors,
                &reference.surface,
                &live.colors,
                &live.surface,
                &self.partials[0],
            ];
            recorder.dispatch(kernel, &arguments, &buffers, groups);
        }
        let result = self.sum(&mut recorder, groups * GROUP, count);
        let bytes = u64::from(count * SYSTEM_ROWS) * size_of::<Row>() as u64;
        let read = recorder.submit_and_read(&self.partials[result], bytes)?;
        let rows: Vec<Row> = bytemuck::pod_collect_to_vec(&read);
        Ok(rows
            .chunks_exact(SYSTEM_ROWS as usize)
            .map(|rows| NormalSystem::from_sums(rows.as_flattened()))
            .collect())
    }

    /// Coarse to fine from `start` to where the live image was taken: [`align`] on the device.
    ///
    /// # Errors
    /// As [`Aligner::system`]; [`GpuError::ShapeMismatch`] when the pyramids have not as many
    /// levels as the schedule, or more.
    pub fn align(
        &mut self,
        reference: &Pyramid,
        live: &Pyramid,
        start: &Estimate,
        schedule: &Schedule,
    ) -> Result<Aligned, GpuError> {
        let available = reference.levels().len().min(live.levels().len());
        let wanted = schedule.steps.len();
        crate::device::expect_len("levels", wanted, available.min(wanted))?;
        align(start, schedule, |level, estimate| {
            let levels = (&reference.levels()[level], &live.levels()[level]);
            self.system(levels.0, levels.1, estimate, &schedule.settings.at_level(level))
        })
    }

    /// Records the sums of `count` partial systems of each comparison; which side holds them.
    fn sum(&self, recorder: &mut Recorder<'_>, mut count: u32, comparisons: u32) -> usize {
        let mut side = 0;
        while count > 1 {
            let runs = count.div_ceil(RUN);
            let arguments = ArrayArguments { count, detail: comparisons };
            let buffers: [&wgpu::Buffer; 2] = [&self.partials[side], &self.partials[1 - side]];
            let threads = (comparisons * runs * SYSTEM_ROWS) as usize;
            recorder.dispatch_threads(&self.sum, &arguments, &buffers, threads);
            (count, side) = (runs, 1 - side);
        }
        side
    }

    /// Room for `systems` partial sums.
    fn reserve(&mut self, systems: usize) -> Result<(), GpuError> {
        let rows = systems * SYSTEM_ROWS as usize;
        if self.partials[0].len() < rows {
            for side in &mut self.partials {
                *side = Buffer::new(&self.gpu, "normal systems", rows)?;
            }
        }
        Ok(())
    }
}

impl Estimate {
    fn check(&self) -> Result<(), GpuError> {
        let pose = self.reference_from_live.to_homogeneous();
        let finite = pose.iter().chain(&self.exposure).all(|v| v.is_finite());
        if finite && self.exposure[0].abs() <= EXPOSURE_LIMIT {
            return Ok(());
        }
        let (what, expected) = ("estimate", "finite pose and exposure, |a| at most 3");
        Err(GpuError::BadValue { what, expected, found: format!("{self:?}") })
    }
}

impl AlignSettings {
    /// These settings for a level: on coarser levels, where the motion may still be large, the depth
    /// gate is wider. A level that has a fourth of the pixels has half of those that are used.
    #[must_use]
    pub fn at_level(&self, level: usize) -> Self {
        let wider = 4f64.powi(level.min(8) as i32);
        let stride = self.stride.div_ceil(1 << level.min(8));
        Self { depth_gate: self.depth_gate * wider, stride, ..*self }
    }

    fn check(&self) -> Result<(), GpuError> {
        let weights = [self.photometric_weight, self.geometric_weight, self.depth_noise];
        let limits = [
            self.photometric_threshold,
            self.photometric_agreement,
            self.geometric_threshold,
            self.geometric_agreement,
            self.depth_gate,
        ];
        let bad = |expected| {
            let found = format!("{self:?}");
            Err(GpuError::BadValue { what: "align settings", expected, found })
        };
        if !weights.iter().all(|w| w.is_finite() && *w >= 0.0) {
            return bad("finite weights and noise of at least 0");
        }
        if !limits.iter().all(|v| v.is_finite() && *v > 0.0) || !self.normal_gate.is_finite() {
            return bad("finite thresholds, agreements and gates above 0");
        }
        if !(1..=64).contains(&self.stride) {
            return bad("a stride of 1 to 64");
        }
        Ok(())
    }
}

/// Those of a comparison alone.
fn arguments(comparison: &Comparison<'_>, settings: &AlignSettings, phase: f64) -> AlignArguments {
    let Comparison { reference, live, estimate } = comparison;
    let pose = estimate.reference_from_live.to_homogeneous().cast::<f32>();
    let row = |i: usize| [pose[(i, 0)], pose[(i, 1)], pose[(i, 2)], pose[(i, 3)]];
    let intrinsics = |level: &Level| {
        let camera = &level.camera;
        [camera.fx, camera.fy, camera.cx, camera.cy]
    };
    AlignArguments {
        pose_x: row(0),
        pose_y: row(1),
        pose_z: row(2),
        reference: intrinsics(reference),
        live: intrinsics(live),
        reference_size: [reference.camera.width, reference.camera.height],
        exposure: [estimate.exposure[0].exp() as f32, estimate.exposure[1] as f32],
        weights: [settings.photometric_weight as f32, settings.geometric_weight as f32],
        thresholds: [
            settings.photometric_threshold,
            settings.geometric_threshold,
            settings.photometric_agreement,
            settings.geometric_agreement,
        ]
        .map(|threshold| threshold as f32),
        gates: [settings.depth_gate, settings.normal_gate, settings.depth_noise, phase]
            .map(|gate| gate as f32),
        live_size: [live.camera.width, live.camera.height],
        count: live.camera.pixels() as u32 / settings.stride,
        stride: settings.stride,
        groups: 0,
        first_group: 0,
    }
}
