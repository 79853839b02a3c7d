//! The pass of one head over one view: project, bin, blend, and the way back. Owns the scratch
//! buffers of that head.
//!
//! Both heads run the same code. They differ in the rows of a feature, and in that color renders
//! depth and moves the mean.

use crate::device::{Buffer, Gpu, GpuError, Tier};
use crate::map::{Arrays, Gaussians, HeadKind};
use crate::pass::binning::Binning;
use crate::pass::blend::{Blend, TileLists, record_rows};
use crate::pass::camera::Camera;
use crate::pass::order::Ranks;
use crate::pass::project::{BackwardInputs, GradientBuffers, Project};
use crate::pass::projected::Projected;
use crate::pass::tiles::Hits;
use crate::primitives::sort::Sort;
use crate::shader::layout::{HitCount, MAX_TILES, PassArguments, PixelState, Row};
use crate::shader::{Recorder, Tiling};

/// Capacity of grown lists, as a multiple of what the view needed.
const HEADROOM: f32 = 1.5;
/// Most hits that lists are made for.
const MAX_HITS: usize = 1 << 28;
/// Fill level from which lists grow, as a share of their capacity.
const FULL: f32 = 0.85;

/// The kernels and scratch buffers of one head.
pub(crate) struct HeadPass {
    kind: HeadKind,
    project: Project,
    blend: Blend,
    rows: usize,
    hit_capacity: usize,
    first_hit_capacity: usize,
    forward: Option<ForwardBuffers>,
    backward: Option<BackwardBuffers>,
    arguments: Option<PassArguments>,
}

/// Buffers of a forward pass.
struct ForwardBuffers {
    projected: Projected,
    hits: Hits,
    image: Buffer<Row>,
    pixels: Buffer<PixelState>,
}

/// Buffers that only a backward pass needs.
pub(crate) struct BackwardBuffers {
    /// In: dL/dimage, height x width x rows.
    pub image_gradients: Buffer<Row>,
    /// Out: dL/dparameters.
    pub gradients: GradientBuffers,
    records: Buffer<Row>,
}

impl HeadPass {
    /// Compiles the kernels of a head for language codes of `channels` values. Lists hold
    /// `hit_capacity` hits at first.
    ///
    /// # Errors
    /// As [`crate::shader::Kernel::new`].
    pub fn new(
        gpu: &Gpu,
        kind: HeadKind,
        channels: usize,
        hit_capacity: usize,
    ) -> Result<Self, GpuError> {
        let (rows, color) = (kind.rows(channels), kind == HeadKind::Color);
        Ok(Self {
            kind,
            project: Project::new(gpu, rows, color)?,
            blend: Blend::new(gpu, rows, color)?,
            rows,
            hit_capacity,
            first_hit_capacity: hit_capacity,
            forward: None,
            backward: None,
            arguments: None,
        })
    }

    /// Makes room for a map and a view, and for the backward pass if `backward` is set.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`]. The lists then start small again, so that one view that needs too
    /// much does not stop the others.
    pub fn reserve(
        &mut self,
        gpu: &Gpu,
        sort: &Sort,
        gaussians: &Gaussians,
        camera: &Camera,
        backward: bool,
    ) -> Result<(), GpuError> {
        let made = self.allocate(gpu, sort, gaussians, camera, backward);
        if made.is_err() {
            self.hit_capacity = self.first_hit_capacity;
            self.release();
        }
        made
    }

    fn allocate(
        &mut self,
        gpu: &Gpu,
        sort: &Sort,
        gaussians: &Gaussians,
        camera: &Camera,
        backward: bool,
    ) -> Result<(), GpuError> {
        let (map, pixels) = (gaussians.capacity(), camera.pixels());
        let [columns, rows] = camera.tiles(Tiling::of(gpu.tier()));
        let tiles = columns as usize * rows as usize;
        if gpu.tier() == Tier::Software && tiles > MAX_TILES {
            let (limit, found, needed) = ("tiles of a picture", MAX_TILES as u64, tiles as u64);
            return Err(GpuError::Limit { limit, found, needed });
        }
        let fits = self.forward.as_ref().is_some_and(|buffers| {
            buffers.projected.splats.len() == map
                && buffers.hits.capacity() == self.hit_capacity
                && buffers.pixels.len() >= pixels
                && buffers.hits.ranges.len() >= tiles
        });
        if !fits {
            self.release();
            self.forward = Some(ForwardBuffers {
                projected: Projected::new(gpu, map)?,
                hits: Hits::new(gpu, sort, self.hit_capacity, map, tiles)?,
                image: Buffer::new(gpu, "image", pixels * self.rows)?,
                pixels: Buffer::new(gpu, "pixel states", pixels)?,
            });
        }
        if backward && self.backward.is_none() {
            let pixels = self.forward.as_ref().map_or(pixels, |buffers| buffers.pixels.len());
            let color = self.kind == HeadKind::Color;
            let records = self.hit_capacity * record_rows(self.rows);
            self.backward = Some(BackwardBuffers {
                image_gradients: Buffer::new(gpu, "image gradients", pixels * self.rows)?,
                gradients: GradientBuffers::new(gpu, map, self.rows, color)?,
                records: Buffer::new(gpu, "records", records)?,
            });
        }
        Ok(())
    }

    fn release(&mut self) {
        (self.forward, self.backward, self.arguments) = (None, None, None);
    }

    /// Records the projection of the first `count` Gaussians. Needs [`HeadPass::reserve`].
    pub fn project(
        &mut self,
        recorder: &mut Recorder<'_>,
        arrays: &Arrays,
        arguments: PassArguments,
    ) {
        let head = arrays.head(self.kind);
        let projected = &self.forward().projected;
        let means = &arrays.means.values;
        self.project.forward(recorder, &arguments, means, head, projected);
        self.arguments = Some(arguments);
    }

    /// Records binning and blending. Needs [`HeadPass::project`] and [`Binning::rank`].
    pub fn blend(&self, recorder: &mut Recorder<'_>, binning: &Binning, arrays: &Arrays) {
        let (forward, lists) = (self.forward(), self.lists());
        let ForwardBuffers { projected, hits, image, pixels } = forward;
        let (ranks, sort) = (binning.ranks(), &binning.sort);
        binning.tiles.list(recorder, lists.arguments, projected, ranks, hits, sort);
        let features = &arrays.head(self.kind).features.values;
        self.blend.forward(recorder, lists, features, image, pixels);
    }

    /// Records the backward pass: dL/dimage to dL/dparameters. Needs the forward pass of the same
    /// view and [`HeadPass::reserve`] with `backward`.
    pub fn backward(&self, recorder: &mut Recorder<'_>, ranks: &Ranks, arrays: &Arrays) {
        let (forward, backward, lists) = (self.forward(), self.backward_buffers(), self.lists());
        let head = arrays.head(self.kind);
        let BackwardBuffers { image_gradients, gradients, records } = backward;
        let (features, pixels) = (&head.features.values, &forward.pixels);
        self.blend.backward(recorder, lists, features, pixels, image_gradients, records);
        let inputs = BackwardInputs {
            means: &arrays.means.values,
            geometry: &head.geometry.values,
            ranks,
            hits: &forward.hits,
            records,
        };
        self.project.backward(recorder, lists.arguments, inputs, gradients);
    }

    /// Number of hits that the lists hold.
    pub fn hit_capacity(&self) -> usize {
        self.hit_capacity
    }

    /// Makes the next lists hold this many hits.
    pub fn set_hit_capacity(&mut self, hits: usize) {
        self.hit_capacity = hits.clamp(1, MAX_HITS);
    }

    /// The projected Gaussians of the last view.
    pub fn projected(&self) -> &Projected {
        &self.forward().projected
    }

    /// The rendered rows, height x width x rows.
    pub fn image(&self) -> &Buffer<Row> {
        &self.forward().image
    }

    /// Transmittance and last hit of each pixel, height x width.
    pub fn pixels(&self) -> &Buffer<PixelState> {
        &self.forward().pixels
    }

    /// First and end of the list of each tile.
    pub fn ranges(&self) -> &Buffer<[u32; 2]> {
        &self.forward().hits.ranges
    }

    /// How many hits the last view needed and how many were drawn.
    pub fn hit_count(&self) -> &Buffer<HitCount> {
        &self.forward().hits.count
    }

    /// Buffers of the backward pass.
    pub fn backward_buffers(&self) -> &BackwardBuffers {
        self.backward.as_ref().expect("reserved by the caller")
    }

    /// Returns true if the lists overflowed. Makes the next lists larger if they did, or if they
    /// are nearly full.
    pub fn grow_after(&mut self, count: HitCount) -> bool {
        let wanted = count.wanted as usize;
        if wanted as f32 > FULL * self.hit_capacity as f32 {
            self.hit_capacity = ((wanted as f32 * HEADROOM) as usize).next_multiple_of(1 << 12);
            tracing::debug!(wanted, capacity = self.hit_capacity, "hit lists grow");
        }
        count.wanted > count.drawn
    }

    /// Sums over the pixels of the last image, per Gaussian of the map: blending weights, and the
    /// number of pixels that the Gaussian reaches with more than half of the light left behind it.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn contributions(&self, gpu: &Gpu, ranks: &Ranks) -> Result<Vec<[f32; 2]>, GpuError> {
        let (forward, lists) = (self.forward(), self.lists());
        let records = Buffer::new(gpu, "contribution records", forward.hits.capacity())?;
        let mut recorder = Recorder::new(gpu)?;
        self.blend.contributions(&mut recorder, lists, &forward.pixels, &records);
        recorder.submit();
        let visible = ranks.visible.read(gpu, 1)?[0].count as usize;
        let gaussians = ranks.gaussian_from_rank.read(gpu, visible)?;
        let slots = forward.hits.slot_from_rank.read(gpu, visible + 1)?;
        let rows: Vec<Row> = records.read(gpu, slots[visible] as usize)?;
        let mut found = vec![[0.0; 2]; lists.arguments.count as usize];
        for (gaussian, range) in gaussians.iter().zip(slots.windows(2)) {
            for row in &rows[range[0] as usize..range[1] as usize] {
                found[*gaussian as usize][0] += row[0];
                found[*gaussian as usize][1] += row[1];
            }
        }
        Ok(found)
    }

    /// Bytes of scratch on the device.
    pub fn device_bytes(&self) -> u64 {
        let forward = self.forward.as_ref().map_or(0, |buffers| {
            buffers.projected.splats.size()
                + buffers.projected.coverage.size()
                + buffers.image.size()
                + buffers.pixels.size()
                + buffers.hits.device_bytes()
        });
        let backward = self.backward.as_ref().map_or(0, |buffers| {
            buffers.records.size()
                + buffers.image_gradients.size()
                + buffers.gradients.device_bytes()
        });
        forward + backward
    }

    /// What blending reads of the last view.
    fn lists(&self) -> TileLists<'_> {
        let forward = self.forward();
        let arguments = self.arguments.as_ref().expect("projected before");
        TileLists { arguments, splats: &forward.projected.splats, hits: &forward.hits }
    }

    fn forward(&self) -> &ForwardBuffers {
        self.forward.as_ref().expect("reserved by the caller")
    }
}
