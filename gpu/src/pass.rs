//! One head's pass over one view: project, list, blend, and back. Owns the scratch buffers.
//!
//! Color and language differ in the rows of their feature and in what depth and mean mean to them;
//! the code is one.

use crate::blend::{Blend, Lists, record_rows};
use crate::buffer::Buffer;
use crate::camera::Camera;
use crate::device::{Gpu, Tier};
use crate::error::GpuError;
use crate::gaussians::{Gaussians, Head, Parameters};
use crate::kernel::Recorder;
use crate::layout::{HitCount, MAX_TILES, PassArguments, PixelState, Row};
use crate::order::{Order, Ranks};
use crate::project::{HeadGradients, Project, Projected};
use crate::reduce::ReduceScratch;
use crate::sort::Sort;
use crate::tally::Found;
use crate::tiles::{Hits, Tiles};

/// Room that lists have beyond what a view wanted.
const HEADROOM: f32 = 1.5;
/// Share of the lists that may be full before they grow.
const FULL: f32 = 0.85;

/// The kernels that both heads share, and the ranks of the view.
pub struct Lister {
    pub(crate) sort: Sort,
    order: Order,
    tiles: Tiles,
    ranks: Option<Ranks>,
}

/// One head's kernels and scratch.
pub struct Pass {
    project: Project,
    blend: Blend,
    rows: usize,
    color: bool,
    hit_capacity: usize,
    first_hit_capacity: usize,
    scratch: Option<Scratch>,
    training: Option<Training>,
    last: Option<PassArguments>,
}

/// Buffers of a forward pass.
struct Scratch {
    projected: Projected,
    hits: Hits,
    image: Buffer<Row>,
    pixels: Buffer<PixelState>,
}

/// Buffers that only a backward pass needs.
pub struct Training {
    /// dL/dimage.
    pub image_gradients: Buffer<Row>,
    /// Terms of the loss, one row per pixel or rank.
    pub terms: Buffer<Row>,
    /// Sums of these.
    pub sums: ReduceScratch,
    /// dL/dparameters.
    pub gradients: HeadGradients,
    /// Bias corrections of the optimiser.
    pub corrections: Buffer<[f32; 2]>,
    records: Buffer<Row>,
}

impl Lister {
    /// Compiles the kernels.
    ///
    /// # Errors
    /// As [`crate::kernel::Kernel::new`].
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let (sort, order, tiles) = (Sort::new(gpu)?, Order::new(gpu)?, Tiles::new(gpu)?);
        Ok(Self { sort, order, tiles, ranks: None })
    }

    /// Makes room to rank a map.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub fn reserve(&mut self, gpu: &Gpu, gaussians: &Gaussians) -> Result<(), GpuError> {
        let capacity = gaussians.capacity();
        if self.ranks.as_ref().is_none_or(|ranks| ranks.capacity() != capacity) {
            self.ranks = None;
            self.ranks = Some(Ranks::new(gpu, &self.sort, capacity)?);
        }
        Ok(())
    }

    /// Ranks the Gaussians that one of the heads shows; they are projected.
    pub fn rank(&self, recorder: &mut Recorder<'_>, heads: &[&Pass], count: usize) {
        let [first, .., last] = heads else {
            let [only] = heads else { return };
            return self.rank(recorder, &[only, only], count);
        };
        let projected = (first.projected(), last.projected());
        self.order.rank(recorder, projected, count, (self.ranks(), &self.sort));
    }

    /// The visible Gaussians of the last view.
    pub fn ranks(&self) -> &Ranks {
        self.ranks.as_ref().expect("reserved by the caller")
    }

    /// Bytes of scratch on the device.
    pub fn device_bytes(&self) -> u64 {
        self.ranks.as_ref().map_or(0, Ranks::device_bytes)
    }
}

impl Pass {
    /// Compiles a head's kernels for features of `rows` rows; lists hold `hit_capacity` hits at
    /// first.
    ///
    /// # Errors
    /// As [`crate::kernel::Kernel::new`].
    pub fn new(gpu: &Gpu, rows: usize, color: bool, hit_capacity: usize) -> Result<Self, GpuError> {
        Ok(Self {
            project: Project::new(gpu, rows, color)?,
            blend: Blend::new(gpu, rows, color)?,
            rows,
            color,
            hit_capacity,
            first_hit_capacity: hit_capacity,
            scratch: None,
            training: None,
            last: None,
        })
    }

    /// Makes room for a map and a view.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`]; the lists then start small again, so that one view that asks for
    /// too much does not stop the others.
    pub fn reserve(
        &mut self,
        gpu: &Gpu,
        sort: &Sort,
        view: (&Gaussians, &Camera),
        training: bool,
    ) -> Result<(), GpuError> {
        let made = self.allocate(gpu, sort, view, training);
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
        (gaussians, camera): (&Gaussians, &Camera),
        training: bool,
    ) -> Result<(), GpuError> {
        let (map, pixels) = (gaussians.capacity(), camera.pixels());
        let [columns, rows] = camera.tiles(gpu.tiling());
        let tiles = columns as usize * rows as usize;
        if gpu.tier() == Tier::Software && tiles > MAX_TILES {
            let (limit, found, needed) = ("tiles of a picture", MAX_TILES as u64, tiles as u64);
            return Err(GpuError::Limit { limit, found, needed });
        }
        let fits = self.scratch.as_ref().is_some_and(|s| {
            s.projected.splats.len() == map
                && s.hits.capacity() == self.hit_capacity
                && s.pixels.len() >= pixels
                && s.hits.ranges.len() >= tiles
        });
        if !fits {
            self.release();
            self.scratch = Some(Scratch {
                projected: Projected::new(gpu, map)?,
                hits: Hits::new(gpu, sort, self.hit_capacity, (map, tiles))?,
                image: Buffer::new(gpu, "image", pixels * self.rows)?,
                pixels: Buffer::new(gpu, "pixel states", pixels)?,
            });
        }
        if training && self.training.is_none() {
            let pixels = self.scratch.as_ref().map_or(pixels, |s| s.pixels.len());
            self.training = Some(Training {
                image_gradients: Buffer::new(gpu, "image gradients", pixels * self.rows)?,
                terms: Buffer::new(gpu, "loss terms", pixels.max(map))?,
                sums: ReduceScratch::new(gpu, pixels.max(map))?,
                gradients: HeadGradients::new(gpu, map, self.rows, self.color)?,
                corrections: Buffer::new(gpu, "corrections", map)?,
                records: Buffer::new(gpu, "records", self.hit_capacity * record_rows(self.rows))?,
            });
        }
        Ok(())
    }

    /// Records the projection of `count` Gaussians; needs [`Pass::reserve`].
    pub fn project(
        &mut self,
        recorder: &mut Recorder<'_>,
        (means, head): (&Parameters, &Head),
        arguments: PassArguments,
    ) {
        let projected = self.projected();
        self.project.forward(recorder, &arguments, (&means.values, head), projected);
        self.last = Some(arguments);
    }

    /// Records lists and blend; needs [`Pass::project`] and [`Lister::rank`].
    pub fn blend(&self, recorder: &mut Recorder<'_>, lister: &Lister, head: &Head) {
        let scratch = self.scratch();
        let lists = self.lists();
        let view = (&scratch.projected, lister.ranks());
        lister.tiles.list(recorder, lists.arguments, view, (&scratch.hits, &lister.sort));
        let picture = (&scratch.image, &scratch.pixels);
        self.blend.forward(recorder, lists, &head.features.values, picture);
    }

    /// Records the backward pass: dL/dimage to dL/dparameters. Needs the forward pass of the same
    /// head and [`Pass::reserve`] with `training`.
    pub fn backward(
        &self,
        recorder: &mut Recorder<'_>,
        ranks: &Ranks,
        (means, head): (&Parameters, &Head),
    ) {
        let (scratch, training) = (self.scratch(), self.training());
        let lists = self.lists();
        let features = &head.features.values;
        let image = (&scratch.pixels, &training.image_gradients);
        self.blend.backward(recorder, lists, features, image, &training.records);
        self.project.backward(
            recorder,
            lists.arguments,
            (&means.values, &head.geometry.values),
            (ranks, &scratch.hits, &training.records),
            &training.gradients,
        );
    }

    /// What the training step found out about each Gaussian; needs the backward pass.
    pub fn found<'a>(&'a self, ranks: &'a Ranks) -> Found<'a> {
        let Training { gradients, corrections, .. } = self.training();
        let Lists { arguments, splats, .. } = self.lists();
        Found { arguments, ranks, corrections, gradients, splats }
    }

    /// Room for this many hits.
    pub fn hit_capacity(&self) -> usize {
        self.hit_capacity
    }

    /// The rendered rows, height x width x rows.
    pub fn image(&self) -> &Buffer<Row> {
        &self.scratch().image
    }

    /// Transmittance and last hit of each pixel.
    pub fn pixels(&self) -> &Buffer<PixelState> {
        &self.scratch().pixels
    }

    /// First and end of each tile's list.
    pub fn ranges(&self) -> &Buffer<[u32; 2]> {
        &self.scratch().hits.ranges
    }

    /// The counters of the lists.
    pub fn hit_count(&self) -> &Buffer<HitCount> {
        &self.scratch().hits.count
    }

    /// Buffers of the backward pass.
    pub fn training(&self) -> &Training {
        self.training.as_ref().expect("reserved by the caller")
    }

    /// True if the lists overflowed. Where they did, or are nearly full, the next ones are larger.
    pub fn outgrown(&mut self, count: HitCount) -> bool {
        let wanted = count.wanted as usize;
        if wanted as f32 > FULL * self.hit_capacity as f32 {
            self.hit_capacity = ((wanted as f32 * HEADROOM) as usize).next_multiple_of(1 << 12);
            tracing::debug!(wanted, capacity = self.hit_capacity, "hit lists grow");
        }
        count.wanted > count.drawn
    }

    /// What each Gaussian gave to the last picture: sum of its blending weights, and the number of
    /// pixels that it reaches with more than half of the light left behind it. Needs the
    /// forward pass.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn contributions(&self, gpu: &Gpu, ranks: &Ranks) -> Result<Vec<[f32; 2]>, GpuError> {
        let (scratch, lists) = (self.scratch(), self.lists());
        let records = Buffer::new(gpu, "touch records", scratch.hits.capacity())?;
        let mut recorder = Recorder::new(gpu)?;
        self.blend.touch(&mut recorder, lists, &scratch.pixels, &records);
        recorder.submit();
        let visible = ranks.visible.read(gpu, 1)?[0].count as usize;
        let gaussians = ranks.gaussian_from_rank.read(gpu, visible)?;
        let slots = scratch.hits.slot_from_rank.read(gpu, visible + 1)?;
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
        let forward = self.scratch.as_ref().map_or(0, |s| {
            s.projected.splats.size()
                + s.projected.coverage.size()
                + s.image.size()
                + s.pixels.size()
                + s.hits.device_bytes()
        });
        let backward = self.training.as_ref().map_or(0, |t| {
            t.records.size()
                + t.image_gradients.size()
                + t.terms.size()
                + t.gradients.device_bytes()
                + t.corrections.size()
        });
        forward + backward
    }

    fn projected(&self) -> &Projected {
        &self.scratch().projected
    }

    fn scratch(&self) -> &Scratch {
        self.scratch.as_ref().expect("reserved by the caller")
    }

    fn lists(&self) -> Lists<'_> {
        let scratch = self.scratch();
        let arguments = self.last.as_ref().expect("projected before");
        Lists { arguments, splats: &scratch.projected.splats, hits: &scratch.hits }
    }

    fn release(&mut self) {
        (self.scratch, self.training, self.last) = (None, None, None);
    }
}
