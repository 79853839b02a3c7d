//! One head's pass over one view: project, list, blend, and back. Owns the scratch buffers.
//!
//! Colour and language differ in the rows of their feature and in what depth and mean mean to them;
//! the code is one.

use crate::blend::{Blend, Lists, record_rows};
use crate::buffer::Buffer;
use crate::camera::Camera;
use crate::device::Gpu;
use crate::error::GpuError;
use crate::gaussians::{Gaussians, Head, Parameters};
use crate::kernel::Recorder;
use crate::layout::{HitCount, PassArguments, PixelState, Row};
use crate::project::{HeadGradients, Project};
use crate::sort::Sort;
use crate::tiles::{Hits, Ranks, Tiles};

/// The kernels that both heads share.
pub struct Lister {
    pub(crate) sort: Sort,
    tiles: Tiles,
}

/// One head's kernels and scratch.
pub struct Pass {
    project: Project,
    blend: Blend,
    rows: usize,
    hit_capacity: usize,
    first_hit_capacity: usize,
    scratch: Option<Scratch>,
    training: Option<Training>,
    last: Option<PassArguments>,
}

/// Buffers of a forward pass.
struct Scratch {
    ranks: Ranks,
    hits: Hits,
    ranges: Buffer<[u32; 2]>,
    image: Buffer<Row>,
    pixels: Buffer<PixelState>,
}

/// Buffers that only a backward pass needs.
pub struct Training {
    /// dL/dimage.
    pub image_gradients: Buffer<Row>,
    /// Terms of the loss, one row per pixel or Gaussian.
    pub terms: Buffer<Row>,
    /// dL/dparameters.
    pub gradients: HeadGradients,
    /// dL/dmean; unused by language.
    pub mean_gradients: Buffer<Row>,
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
        Ok(Self { sort: Sort::new(gpu)?, tiles: Tiles::new(gpu)? })
    }
}

impl Pass {
    /// Compiles a head's kernels for features of `rows` rows; lists hold `hit_capacity` hits at
    /// first.
    ///
    /// # Errors
    /// As [`crate::kernel::Kernel::new`].
    pub fn new(
        gpu: &Gpu,
        rows: usize,
        colour: bool,
        hit_capacity: usize,
    ) -> Result<Self, GpuError> {
        Ok(Self {
            project: Project::new(gpu, colour)?,
            blend: Blend::new(gpu, rows, colour)?,
            rows,
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
        lister: &Lister,
        view: (&Gaussians, &Camera),
        training: bool,
    ) -> Result<(), GpuError> {
        let made = self.allocate(gpu, lister, view, training);
        if made.is_err() {
            self.hit_capacity = self.first_hit_capacity;
            (self.scratch, self.training, self.last) = (None, None, None);
        }
        made
    }

    fn allocate(
        &mut self,
        gpu: &Gpu,
        lister: &Lister,
        (gaussians, camera): (&Gaussians, &Camera),
        training: bool,
    ) -> Result<(), GpuError> {
        let (map, pixels) = (gaussians.capacity(), camera.pixels());
        let tiles = camera.tiles()[0] as usize * camera.tiles()[1] as usize;
        let fits = self.scratch.as_ref().is_some_and(|s| {
            s.ranks.hits.len() == map && s.pixels.len() >= pixels && s.ranges.len() >= tiles
        });
        if !fits {
            self.last = None;
            (self.scratch, self.training) = (None, None);
            self.scratch = Some(Scratch {
                ranks: Ranks::new(gpu, &lister.sort, map)?,
                hits: Hits::new(gpu, &lister.sort, self.hit_capacity)?,
                ranges: Buffer::new(gpu, "tile ranges", tiles)?,
                image: Buffer::new(gpu, "image", pixels * self.rows)?,
                pixels: Buffer::new(gpu, "pixel states", pixels)?,
            });
        }
        if training && self.training.is_none() {
            let pixels = self.scratch.as_ref().map_or(pixels, |s| s.pixels.len());
            self.training = Some(Training {
                image_gradients: Buffer::new(gpu, "image gradients", pixels * self.rows)?,
                terms: Buffer::new(gpu, "loss terms", pixels.max(map))?,
                gradients: HeadGradients::new(gpu, map, self.rows)?,
                mean_gradients: Buffer::new(gpu, "mean gradients", map)?,
                corrections: Buffer::new(gpu, "corrections", map)?,
                records: Buffer::new(gpu, "records", self.hit_capacity * record_rows(self.rows))?,
            });
        }
        Ok(())
    }

    /// Records the forward pass of `head` for a view; needs [`Pass::reserve`].
    pub fn forward(
        &mut self,
        gpu: &Gpu,
        recorder: &mut Recorder<'_>,
        lister: &Lister,
        (means, head, count): (&Parameters, &Head, usize),
        camera: &Camera,
    ) {
        let arguments = camera.arguments(count, self.hit_capacity);
        let scratch = self.scratch.as_ref().expect("reserved by the caller");
        let (ranks, hits, ranges) = (&scratch.ranks, &scratch.hits, &scratch.ranges);
        ranks.count.write(gpu, 0, &[count as u32]);
        self.project.forward(recorder, &arguments, (&means.values, &head.geometry.values), ranks);
        lister.tiles.list(recorder, &arguments, (ranks, hits, ranges), &lister.sort);
        let lists = Lists { arguments: &arguments, ranks, hits, ranges };
        let picture = (&scratch.image, &scratch.pixels);
        self.blend.forward(recorder, lists, &head.features.values, picture);
        self.last = Some(arguments);
    }

    /// Records the backward pass: dL/dimage to dL/dparameters. Needs the forward pass of the same
    /// head and [`Pass::reserve`] with `training`.
    pub fn backward(&self, recorder: &mut Recorder<'_>, means: &Parameters, head: &Head) {
        let scratch = self.scratch.as_ref().expect("reserved by the caller");
        let training = self.training.as_ref().expect("reserved by the caller");
        let arguments = self.last.as_ref().expect("forward went before");
        let lists = Lists {
            arguments,
            ranks: &scratch.ranks,
            hits: &scratch.hits,
            ranges: &scratch.ranges,
        };
        self.blend.backward(
            recorder,
            lists,
            &head.features.values,
            (&scratch.pixels, &training.image_gradients),
            &training.records,
        );
        self.project.backward(
            recorder,
            arguments,
            (&means.values, &head.geometry.values),
            (&scratch.ranks, &training.records),
            (&training.mean_gradients, &training.gradients),
        );
    }

    /// The rendered rows, height x width x rows.
    pub fn image(&self) -> &Buffer<Row> {
        &self.scratch.as_ref().expect("reserved by the caller").image
    }

    /// Transmittance and last hit of each pixel.
    pub fn pixels(&self) -> &Buffer<PixelState> {
        &self.scratch.as_ref().expect("reserved by the caller").pixels
    }

    /// The counters of the lists.
    pub fn hit_count(&self) -> &Buffer<HitCount> {
        &self.scratch.as_ref().expect("reserved by the caller").hits.count
    }

    /// Buffers of the backward pass.
    pub fn training(&self) -> &Training {
        self.training.as_ref().expect("reserved by the caller")
    }

    /// True if the lists overflowed; they are then dropped and the next ones are larger: the pass
    /// must be repeated.
    pub fn outgrown(&mut self, count: HitCount) -> bool {
        if count.wanted <= count.drawn {
            return false;
        }
        let wanted = count.wanted as usize;
        self.hit_capacity = (wanted + wanted / 4).next_multiple_of(1 << 12);
        tracing::debug!(wanted, capacity = self.hit_capacity, "hit lists grow");
        (self.scratch, self.training, self.last) = (None, None, None);
        true
    }

    /// Largest blending weight of each Gaussian in the last forward pass; nothing without one.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn weights(&self, gpu: &Gpu) -> Result<Vec<f32>, GpuError> {
        let (Some(scratch), Some(arguments)) = (&self.scratch, &self.last) else {
            return Ok(Vec::new());
        };
        let count = arguments.count as usize;
        let weights = Buffer::new(gpu, "weights", count)?;
        let lists = Lists {
            arguments,
            ranks: &scratch.ranks,
            hits: &scratch.hits,
            ranges: &scratch.ranges,
        };
        let mut recorder = Recorder::new(gpu)?;
        self.blend.weights(&mut recorder, lists, &scratch.pixels, &weights);
        recorder.submit();
        Ok(weights.read(gpu, count)?.into_iter().map(f32::from_bits).collect())
    }

    /// Bytes of scratch on the device.
    pub fn device_bytes(&self) -> u64 {
        let forward = self.scratch.as_ref().map_or(0, |s| {
            s.ranks.splats.size()
                + s.image.size()
                + s.pixels.size()
                + s.hits.sort.keys[0].size() * 6
        });
        let backward = self.training.as_ref().map_or(0, |t| {
            t.records.size() + t.image_gradients.size() + t.gradients.features.size()
        });
        forward + backward
    }
}
