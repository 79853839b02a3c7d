//! Which Gaussians stay, which are copied or split, and where each goes: everything of
//! densification but the moving.
//!
//! In: log scales and opacity logits of both heads, the statistics of the last views
//! ([`Statistics`](crate::Statistics)). Out: `source`, one entry per Gaussian afterwards, for
//! [`Gather`](crate::primitives::gather::Gather): index of the Gaussian it comes from, and marks.
//!
//! A Gaussian is, in this order (Kerbl et al. 2023, for two heads as the disentangled map needs):
//!
//! - *pruned* if both heads' opacities are below a limit, or the color head's largest scale (if
//!   asked for, either head's) or the largest radius on the screen is above one, or a parameter
//!   that decides this is not a number, or the mean is not finite;
//! - *cloned* if the mean gradient of its place on the screen reaches a threshold and the scales of
//!   both heads are small: the copy has the same parameters;
//! - *split* if it reaches the threshold and the color head is large: two children, drawn from
//!   N(mean, Sigma_c), with the scales of both heads divided by 1.6, take its place. If only the
//!   language head is large it is left alone: a split would cut a small color head.
//!
//! The clone's original keeps its optimiser state; copies and children start at zero. Births stand
//! next to their origin, so a spatial order survives. Limits are compared as logarithms and logits,
//! so no arithmetic of the device can change a decision.
//!
//! Nothing here moves or frees a Gaussian; a total beyond `max_gaussians` is cut at the births, in
//! the order of Gaussians.

use crate::device::{Buffer, Gpu, GpuError};
use crate::map::arrays::Arrays;
use crate::primitives::scan::{Scan, ScanScratch};
use crate::shader::layout::{DensifyArguments, INDEX_MASK, Row, SurgeryCounts};
use crate::shader::{Access, GRID, Kernel, Recorder, SCALES, Shader};

/// When a Gaussian is pruned, cloned or split.
#[derive(Clone, Debug, PartialEq)]
pub struct DensifyRules {
    /// Mean gradient of the place on the screen, in units of half the image's size, from which a
    /// Gaussian gives birth.
    pub min_gradient: f32,
    /// Largest scale of a Gaussian that is cloned, metres; a larger one is split.
    pub clone_scale: f32,
    /// A Gaussian whose opacity is below this in both heads is pruned; in [0, 1].
    pub min_opacity: f32,
    /// A Gaussian with a larger scale is pruned, metres.
    pub max_scale: Option<f32>,
    /// True if `max_scale` holds for the language head as well.
    pub either_head: bool,
    /// A Gaussian that had a larger radius on some screen is pruned, pixels.
    pub max_radius: Option<f32>,
    /// No birth makes the map larger than this.
    pub max_gaussians: usize,
    /// Seed of the positions of children.
    pub seed: u32,
}

/// What a densification did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DensifyCounts {
    /// Gaussians that got a copy.
    pub cloned: usize,
    /// Gaussians that two children replaced.
    pub split: usize,
    /// Gaussians that were removed.
    pub pruned: usize,
    /// Gaussians afterwards.
    pub len: usize,
}

/// The kernels.
pub struct Densify {
    decide: Kernel,
    flags: Kernel,
    count: Kernel,
    emit: Kernel,
    split: Kernel,
}

/// Who stays and who gives birth among the Gaussians of one map: flags, then, scanned, how many
/// before each.
pub struct Plan {
    kept: Buffer<u32>,
    births: Buffer<u32>,
    splits: Buffer<u32>,
    counts: Buffer<SurgeryCounts>,
    scan: ScanScratch,
}

/// This kernel's shaders.
pub fn shaders() -> [Shader; 5] {
    use Access::{Read, Write};
    let shader = |label, parts, bindings| Shader {
        label,
        entry: "main",
        parts,
        constants: Vec::new(),
        bindings,
    };
    [
        shader(
            "densify_decide",
            vec![GRID, include_str!("decide.wgsl")],
            vec![Read, Read, Read, Read, Write, Write, Write],
        ),
        shader("densify_flags", vec![GRID, include_str!("flags.wgsl")], vec![Read, Write]),
        shader(
            "densify_count",
            vec![GRID, include_str!("count.wgsl")],
            vec![Read, Read, Read, Write],
        ),
        shader(
            "densify_emit",
            vec![GRID, include_str!("emit.wgsl")],
            vec![Read, Read, Read, Read, Write],
        ),
        shader(
            "densify_split",
            vec![GRID, SCALES, include_str!("split.wgsl")],
            vec![Read, Write, Write, Write],
        ),
    ]
}

impl DensifyRules {
    /// The rules as the kernels see them, for `count` Gaussians.
    ///
    /// # Errors
    /// [`GpuError::BadValue`] for a limit that is not a number, a negative one, or an opacity
    /// above 1.
    pub fn arguments(&self, count: usize) -> Result<DensifyArguments, GpuError> {
        let positive = |what, value: f32| match value >= 0.0 {
            true => Ok(value),
            false => bad(what, "a number from 0 on", value),
        };
        if !(0.0..=1.0).contains(&self.min_opacity) {
            return bad("min_opacity", "a number from 0 to 1", self.min_opacity);
        }
        let max_scale = positive("max_scale", self.max_scale.unwrap_or(f32::MAX))?;
        Ok(DensifyArguments {
            count: count as u32,
            max_gaussians: self.max_gaussians.min(INDEX_MASK as usize) as u32,
            seed: self.seed,
            either_head: u32::from(self.either_head),
            min_gradient: positive("min_gradient", self.min_gradient)?.min(f32::MAX),
            clone_log_scale: finite(positive("clone_scale", self.clone_scale)?.ln()),
            min_logit: finite((self.min_opacity / (1.0 - self.min_opacity)).ln()),
            max_log_scale: if self.max_scale.is_some() { finite(max_scale.ln()) } else { f32::MAX },
            max_radius: positive("max_radius", self.max_radius.unwrap_or(f32::MAX))?.min(f32::MAX),
        })
    }
}

/// The same number, or the largest there is in its direction: devices need not know infinity.
fn finite(value: f32) -> f32 {
    value.clamp(f32::MIN, f32::MAX)
}

fn bad<T>(what: &'static str, expected: &'static str, found: f32) -> Result<T, GpuError> {
    Err(GpuError::BadValue { what, expected, found: found.to_string() })
}

impl Plan {
    /// Room for a map of `len` Gaussians.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn new(gpu: &Gpu, scan: &Scan, len: usize) -> Result<Self, GpuError> {
        Ok(Self {
            kept: Buffer::new(gpu, "kept", len + 1)?,
            births: Buffer::new(gpu, "births", len + 1)?,
            splits: Buffer::new(gpu, "splits", len + 1)?,
            counts: Buffer::new(gpu, "surgery counts", 1)?,
            scan: scan.scratch(gpu, len + 1)?,
        })
    }

    /// Waits for the device and reads the totals; needs [`Densify::decide`] or
    /// [`Densify::flags`].
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn counts(&self, gpu: &Gpu) -> Result<SurgeryCounts, GpuError> {
        Ok(self.counts.read(gpu, 1)?[0])
    }
}

impl Densify {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [decide, flags, count, emit, split] = shaders();
        Ok(Self {
            decide: Kernel::new(gpu, &decide)?,
            flags: Kernel::new(gpu, &flags)?,
            count: Kernel::new(gpu, &count)?,
            emit: Kernel::new(gpu, &emit)?,
            split: Kernel::new(gpu, &split)?,
        })
    }

    /// Fills a plan by the rules.
    pub fn decide(
        &self,
        recorder: &mut Recorder<'_>,
        arguments: &DensifyArguments,
        (arrays, scan): (&Arrays, &Scan),
        plan: &Plan,
    ) {
        let color = &arrays.color.geometry.values;
        let language = &arrays.language.geometry.values;
        let inputs: [&wgpu::Buffer; 4] =
            [color, language, &arrays.statistics, &arrays.means.values];
        let outputs: [&wgpu::Buffer; 3] = [&plan.kept, &plan.births, &plan.splits];
        let elements = arguments.count as usize + 1;
        recorder.dispatch_threads(
            &self.decide,
            arguments,
            &[&inputs[..], &outputs[..]].concat(),
            elements,
        );
        for flags in [&plan.births, &plan.splits] {
            scan.exclusive(recorder, flags, elements, &plan.scan);
        }
        self.total(recorder, arguments, scan, plan);
    }

    /// Fills a fresh plan with flags, one per Gaussian; any but 0 stays. There are no births.
    pub fn flags(
        &self,
        recorder: &mut Recorder<'_>,
        flags: &Buffer<u32>,
        (count, scan): (usize, &Scan),
        plan: &Plan,
    ) {
        let arguments = DensifyArguments { count: count as u32, ..Default::default() };
        recorder.dispatch_threads(&self.flags, &arguments, &[flags, &plan.kept], count + 1);
        self.total(recorder, &arguments, scan, plan);
    }

    fn total(
        &self,
        recorder: &mut Recorder<'_>,
        arguments: &DensifyArguments,
        scan: &Scan,
        plan: &Plan,
    ) {
        scan.exclusive(recorder, &plan.kept, arguments.count as usize + 1, &plan.scan);
        let buffers: [&wgpu::Buffer; 4] = [&plan.kept, &plan.births, &plan.splits, &plan.counts];
        recorder.dispatch_threads(&self.count, arguments, &buffers, 1);
    }

    /// Fills `source`, which has the plan's total as its length, for a map of `count` Gaussians.
    pub fn emit(
        &self,
        recorder: &mut Recorder<'_>,
        count: usize,
        plan: &Plan,
        source: &Buffer<u32>,
    ) {
        let arguments = DensifyArguments { count: count as u32, ..Default::default() };
        recorder.dispatch_threads(
            &self.emit,
            &arguments,
            &[&plan.kept, &plan.births, &plan.splits, &plan.counts, source],
            count,
        );
    }

    /// Moves the children of splits, whose parents' parameters were gathered by `source`, and
    /// shrinks them.
    pub fn split(
        &self,
        recorder: &mut Recorder<'_>,
        seed: u32,
        source: &Buffer<u32>,
        (means, color, language): (&Buffer<Row>, &Buffer<Row>, &Buffer<Row>),
    ) {
        let count = source.len();
        let arguments = DensifyArguments { count: count as u32, seed, ..Default::default() };
        let buffers: [&wgpu::Buffer; 4] = [source, means, color, language];
        recorder.dispatch_threads(&self.split, &arguments, &buffers, count);
    }
}
