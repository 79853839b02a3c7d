//! The pass of one head over one view: project, bin, blend, and the way back. Owns the scratch
//! buffers of that head.
//!
//! A picture whose lists are too long for the device is cut into bands (`bands.rs`).
//!
//! Both heads run the same code. They differ in the rows of a feature, and in that color renders
//! depth and moves the mean.

use crate::device::{Buffer, Gpu, GpuError};
use crate::map::{Arrays, Gaussians, HeadKind};
use crate::pass::bands::{Bands, Demand, HEADROOM};
use crate::pass::binning::Binning;
use crate::pass::blend::{Blend, TileLists, record_rows};
use crate::pass::camera::Camera;
use crate::pass::project::{BackwardInputs, GradientBuffers, Project};
use crate::pass::projected::Projected;
use crate::pass::tiles::Hits;
use crate::primitives::sort::Sort;
use crate::shader::layout::{HitCount, PassArguments, PixelState, Row};
use crate::shader::{Recorder, Tiling};

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
    /// Hits of a view that there is room for, over all bands.
    hit_capacity: usize,
    first_hit_capacity: usize,
    /// Most hits of one list.
    list_limit: usize,
    forward: Option<ForwardBuffers>,
    backward: Option<BackwardBuffers>,
    arguments: Option<PassArguments>,
}

/// Buffers of a forward pass.
struct ForwardBuffers {
    /// Of the view that is drawn.
    bands: Bands,
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
            list_limit: usize::MAX,
            forward: None,
            backward: None,
            arguments: None,
        })
    }

    /// Makes room for a map and a view, and for the backward pass if `backward` is set.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::Limit`]. The lists then start small again, so that one
    /// view that needs too much does not stop the others.
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
        // A pass that was taken back once keeps its records, and with them the bands that they allow.
        let backward = backward || self.backward.is_some();
        let tiles = camera.tiles(Tiling::of(gpu.tier()));
        let bands = self.cut(gpu, pixels, tiles, map, backward)?;
        let capacity = bands.capacity();
        let tiles = [bands.most_tiles(), tiles[0] as usize * tiles[1] as usize];
        let fits = self.forward.as_ref().is_some_and(|buffers| {
            let room = buffers.hits.tiles();
            buffers.projected.splats.len() == map
                && buffers.hits.capacity() == capacity
                && buffers.pixels.len() >= pixels
                && room[0] >= tiles[0]
                && room[1] >= tiles[1]
        });
        if fits {
            self.forward.as_mut().expect("it fits").bands = bands;
        } else {
            self.release();
            self.forward = Some(ForwardBuffers {
                bands,
                projected: Projected::new(gpu, map, tiles[1])?,
                hits: Hits::new(gpu, sort, capacity, map, tiles)?,
                image: Buffer::new(gpu, "image", pixels * self.rows)?,
                pixels: Buffer::new(gpu, "pixel states", pixels)?,
            });
        }
        if backward && self.backward.is_none() {
            let pixels = self.forward.as_ref().map_or(pixels, |buffers| buffers.pixels.len());
            let color = self.kind == HeadKind::Color;
            let records = capacity * record_rows(self.rows);
            self.backward = Some(BackwardBuffers {
                image_gradients: Buffer::new(gpu, "image gradients", pixels * self.rows)?,
                gradients: GradientBuffers::new(gpu, map, self.rows, color)?,
                records: Buffer::new(gpu, "records", records)?,
            });
        }
        Ok(())
    }

    /// Cuts a picture into bands.
    fn cut(
        &self,
        gpu: &Gpu,
        pixels: usize,
        tiles: [u32; 2],
        gaussians: usize,
        backward: bool,
    ) -> Result<Bands, GpuError> {
        let most = Buffer::<Row>::most(gpu) / self.rows;
        if pixels > most {
            let (limit, found, needed) = ("pixels of a picture", most as u64, pixels as u64);
            return Err(GpuError::Limit { limit, found, needed });
        }
        let record_rows = if backward { record_rows(self.rows) } else { 1 };
        let (hits, most) = (self.hit_capacity, self.list_limit);
        Bands::fewest(gpu, Demand { tiles, hits, gaussians, record_rows, most })
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
        self.arguments = Some(arguments);
        let head = arrays.head(self.kind);
        let projected = &self.forward().projected;
        let means = &arrays.means.values;
        for band in self.bands() {
            self.project.forward(recorder, &band, means, head, projected);
        }
    }

    /// Records binning and blending. Needs [`HeadPass::project`] and [`Binning::rank`].
    pub fn blend(&self, recorder: &mut Recorder<'_>, binning: &Binning, arrays: &Arrays) {
        let ForwardBuffers { image, pixels, .. } = self.forward();
        let features = &arrays.head(self.kind).features.values;
        for band in self.bands() {
            self.list(recorder, binning, &band);
            self.blend.forward(recorder, self.lists(&band), features, image, pixels);
        }
    }

    /// Records the backward pass: dL/dimage to dL/dparameters. Needs the forward pass of the same
    /// view and [`HeadPass::reserve`] with `backward`.
    pub fn backward(&self, recorder: &mut Recorder<'_>, binning: &Binning, arrays: &Arrays) {
        let (forward, backward) = (self.forward(), self.backward_buffers());
        let (head, ranks) = (arrays.head(self.kind), binning.ranks());
        let BackwardBuffers { image_gradients, gradients, records } = backward;
        let (features, pixels) = (&head.features.values, &forward.pixels);
        let inputs = BackwardInputs {
            means: &arrays.means.values,
            geometry: &head.geometry.values,
            ranks,
            hits: &forward.hits,
            records,
        };
        for band in self.bands() {
            self.list_again(recorder, binning, &band);
            let lists = self.lists(&band);
            self.blend.backward(recorder, lists, features, pixels, image_gradients, records);
            self.project.collect(recorder, &band, inputs, gradients);
        }
        self.project.backward(recorder, self.arguments(), inputs, gradients);
    }

    /// Number of hits of a view that there is room for, over all bands.
    pub fn hit_capacity(&self) -> usize {
        self.hit_capacity
    }

    /// Number of hits that the lists of a band hold.
    pub fn list_capacity(&self) -> usize {
        self.forward().hits.capacity()
    }

    /// Makes lists hold at most so many hits.
    pub fn limit_lists(&mut self, hits: usize) {
        self.list_limit = hits.max(1);
        self.hit_capacity = self.hit_capacity.min(self.list_limit);
        self.first_hit_capacity = self.first_hit_capacity.min(self.list_limit);
    }

    /// Makes the next lists hold this many hits, over all bands.
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
        count.missing > 0
    }

    /// Sums over the pixels of the last image, per Gaussian of the map: blending weights, and the
    /// number of pixels that the Gaussian reaches with more than half of the light left behind it.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn contributions(&self, gpu: &Gpu, binning: &Binning) -> Result<Vec<[f32; 2]>, GpuError> {
        let (forward, ranks) = (self.forward(), binning.ranks());
        let records = Buffer::new(gpu, "contribution records", forward.hits.capacity())?;
        let visible = ranks.visible.read(gpu, 1)?[0].count as usize;
        let gaussians = ranks.gaussian_from_rank.read(gpu, visible)?;
        let mut found = vec![[0.0; 2]; self.arguments().count as usize];
        for band in self.bands() {
            let mut recorder = Recorder::new(gpu)?;
            self.list_again(&mut recorder, binning, &band);
            self.blend.contributions(&mut recorder, self.lists(&band), &forward.pixels, &records);
            recorder.submit();
            let slots = forward.hits.slot_from_rank.read(gpu, visible + 1)?;
            let rows: Vec<Row> = records.read(gpu, slots[visible] as usize)?;
            for (gaussian, range) in gaussians.iter().zip(slots.windows(2)) {
                for row in &rows[range[0] as usize..range[1] as usize] {
                    found[*gaussian as usize][0] += row[0];
                    found[*gaussian as usize][1] += row[1];
                }
            }
        }
        Ok(found)
    }

    /// Bytes of scratch on the device.
    pub fn device_bytes(&self) -> u64 {
        let forward = self.forward.as_ref().map_or(0, |buffers| {
            buffers.projected.device_bytes()
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

    fn arguments(&self) -> &PassArguments {
        self.arguments.as_ref().expect("projected before")
    }

    /// The arguments of each band of the view, from top to bottom.
    fn bands(&self) -> impl Iterator<Item = PassArguments> + use<> {
        self.forward().bands.each(*self.arguments())
    }

    /// Records the lists of a band.
    fn list(&self, recorder: &mut Recorder<'_>, binning: &Binning, band: &PassArguments) {
        let ForwardBuffers { projected, hits, .. } = self.forward();
        binning.tiles.list(recorder, band, projected, binning.ranks(), hits, &binning.sort);
    }

    /// As [`HeadPass::list`], behind the forward pass, which leaves the lists of its last band.
    fn list_again(&self, recorder: &mut Recorder<'_>, binning: &Binning, band: &PassArguments) {
        if self.forward().bands.several() {
            self.list(recorder, binning, band);
        }
    }

    /// What blending reads of a band of the view.
    fn lists<'a>(&'a self, band: &'a PassArguments) -> TileLists<'a> {
        let ForwardBuffers { projected, hits, .. } = self.forward();
        TileLists { arguments: band, projected, hits }
    }

    fn forward(&self) -> &ForwardBuffers {
        self.forward.as_ref().expect("reserved by the caller")
    }
}
