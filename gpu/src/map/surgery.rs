//! Surgery on a map that stays on the device: remove, copy, split, re-order.
//!
//! Every operation ends in one list, `source[i]`: where Gaussian i comes from, with the marks of
//! [`crate::shader::layout`]. Array by array, the map is gathered into one scratch array, as large as the
//! widest of them, and copied back. All that can fail comes before the first array moves.

use std::sync::Arc;

use crate::device::{Buffer, Gpu, GpuError, expect_len};
use crate::map::arrays::{Arrays, widest_bytes};
use crate::map::densify::{DensifyCounts, DensifyRules, Plan};
use crate::map::gaussians::Gaussians;
use crate::map::morton;
use crate::map::statistics::Statistics;
use crate::map::tools::Tools;
use crate::shader::Recorder;

/// Everything that moving needs, allocated before anything moves.
struct Mover<'a> {
    tools: &'a Tools,
    recorder: Recorder<'a>,
    scratch: Buffer<u32>,
}

impl<'a> Mover<'a> {
    /// Room to move maps of `len` Gaussians with `channels` language channels.
    fn new(gpu: &'a Gpu, tools: &'a Tools, len: usize, channels: usize) -> Result<Self, GpuError> {
        let words = len * widest_bytes(channels) / size_of::<u32>();
        let scratch = Buffer::new(gpu, "surgery scratch", words)?;
        Ok(Self { tools, recorder: Recorder::new(gpu)?, scratch })
    }

    /// Records the move of every array.
    fn rearrange(&mut self, arrays: &Arrays, source: &Buffer<u32>) {
        for array in arrays.all() {
            let (gather, buffers) = (&self.tools.gather, (array.buffer, &*self.scratch));
            if array.state {
                gather.gather_state(&mut self.recorder, source, buffers, array.width);
            } else {
                gather.gather(&mut self.recorder, source, buffers, array.width);
            }
            let bytes = (source.len() * array.width * size_of::<u32>()) as u64;
            self.recorder.copy(&self.scratch, (array.buffer, 0), bytes);
        }
    }
}

impl Gaussians {
    /// Keeps the Gaussians whose flag is set, in order, with their optimiser state.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`] unless there is one flag per Gaussian,
    /// [`GpuError::OutOfMemory`]; the map is then as it was.
    pub fn retain(&mut self, keep: &[bool]) -> Result<(), GpuError> {
        expect_len("keep", self.len, keep.len())?;
        let index: Vec<u32> =
            (0u32..).zip(keep).filter(|(_, keep)| **keep).map(|(i, _)| i).collect();
        if index.len() == self.len {
            return Ok(());
        }
        let (gpu, tools) = (self.gpu.clone(), self.tools()?);
        let source = Buffer::from_slice(&gpu, "source", &index)?;
        let mut mover = Mover::new(&gpu, &tools, index.len(), self.channels)?;
        if let Some(arrays) = &self.arrays {
            mover.rearrange(arrays, &source);
        }
        mover.recorder.submit();
        self.len = index.len();
        Ok(())
    }

    /// As [`Gaussians::retain`], by flags on the device: any but 0 stays. Flags beyond the last
    /// Gaussian are ignored.
    ///
    /// # Errors
    /// As [`Gaussians::retain`], if there are too few flags.
    pub fn retain_flagged(&mut self, keep: &Buffer<u32>) -> Result<(), GpuError> {
        expect_len("keep", self.len, keep.len().min(self.len))?;
        if self.is_empty() {
            return Ok(());
        }
        let (gpu, tools) = (self.gpu.clone(), self.tools()?);
        let plan = Plan::new(&gpu, tools.sort.scan(), self.len)?;
        let mut recorder = Recorder::new(&gpu)?;
        tools.densify.flags(&mut recorder, keep, (self.len, tools.sort.scan()), &plan);
        recorder.submit();
        self.follow(&tools, &plan, 0).map(|_| ())
    }

    /// Prunes, clones and splits by the statistics of the last views; see [`crate::map::densify`]. The
    /// statistics are not cleared.
    ///
    /// # Errors
    /// [`GpuError::BadValue`] for rules that are no numbers, [`GpuError::OutOfMemory`]; the map is
    /// then as it was.
    pub fn densify(&mut self, rules: &DensifyRules) -> Result<DensifyCounts, GpuError> {
        let arguments = rules.arguments(self.len)?;
        let (gpu, tools) = (self.gpu.clone(), self.tools()?);
        let Some(arrays) = self.arrays.as_ref().filter(|_| self.len > 0) else {
            return Ok(DensifyCounts::default());
        };
        let plan = Plan::new(&gpu, tools.sort.scan(), self.len)?;
        let mut recorder = Recorder::new(&gpu)?;
        let inputs = (arrays, tools.sort.scan());
        tools.densify.decide(&mut recorder, &arguments, inputs, &plan);
        recorder.submit();
        self.follow(&tools, &plan, rules.seed)
    }

    /// Puts Gaussians in Morton order of their means, so that neighbours in space are neighbours in
    /// memory; means that are not finite come last. Pictures stay as they are but for Gaussians at
    /// exactly the same depth.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`]; the map is then as it was.
    pub fn reorder_morton(&mut self) -> Result<(), GpuError> {
        let (gpu, tools) = (self.gpu.clone(), self.tools()?);
        let Some(arrays) = self.arrays.as_ref().filter(|_| self.len > 1) else {
            return Ok(());
        };
        let means = &arrays.means.values;
        let Some((low, high)) = tools.morton.bounds(&gpu, means, self.len)? else {
            return Ok(());
        };
        let arguments = morton::arguments(low, high, self.len);
        let buffers = tools.sort.buffers(&gpu, self.len, morton::KEY_BITS)?;
        let count = Buffer::from_slice(&gpu, "gaussian count", &[self.len as u32])?;
        let mut mover = Mover::new(&gpu, &tools, self.len, self.channels)?;
        tools.morton.codes(&mut mover.recorder, &arguments, means, &buffers);
        tools.sort.sort(&mut mover.recorder, &buffers, &count);
        mover.rearrange(arrays, &buffers.values[buffers.side()]);
        mover.recorder.submit();
        Ok(())
    }

    /// The statistics of each Gaussian, waited for.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn statistics(&self) -> Result<Vec<Statistics>, GpuError> {
        let Some(arrays) = &self.arrays else { return Ok(Vec::new()) };
        let rows = arrays.statistics.read(&self.gpu, Statistics::ROWS * self.len)?;
        let pairs = rows.chunks_exact(Statistics::ROWS);
        Ok(pairs.map(|pair| Statistics::from_rows([pair[0], pair[1]])).collect())
    }

    /// Replaces all statistics.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`] unless there is one per Gaussian.
    pub fn set_statistics(&mut self, statistics: &[Statistics]) -> Result<(), GpuError> {
        expect_len("statistics", self.len, statistics.len())?;
        if let Some(arrays) = &self.arrays {
            let rows: Vec<_> = statistics.iter().flat_map(Statistics::to_rows).collect();
            arrays.statistics.write(&self.gpu, 0, &rows);
        }
        Ok(())
    }

    /// Sets all statistics to zero.
    pub fn clear_statistics(&mut self) {
        if let Some(arrays) = &self.arrays {
            let mut encoder = self.gpu.device().create_command_encoder(&Default::default());
            encoder.clear_buffer(&arrays.statistics, 0, None);
            self.gpu.queue().submit([encoder.finish()]);
        }
    }

    /// Carries out a plan.
    fn follow(&mut self, tools: &Tools, plan: &Plan, seed: u32) -> Result<DensifyCounts, GpuError> {
        let gpu = self.gpu.clone();
        let counts = plan.counts(&gpu)?;
        let (kept, born, total) =
            (counts.kept as usize, counts.born as usize, counts.total as usize);
        let split = counts.split as usize;
        let done =
            DensifyCounts { cloned: born - split, split, pruned: self.len - kept, len: total };
        if born == 0 && kept == self.len {
            return Ok(done);
        }
        self.reserve(total)?;
        let source = Buffer::new(&gpu, "source", total)?;
        let mut mover = Mover::new(&gpu, tools, total, self.channels)?;
        let arrays = self.arrays.as_ref().expect("a plan is made for a map with arrays");
        tools.densify.emit(&mut mover.recorder, self.len, plan, &source);
        mover.rearrange(arrays, &source);
        if split > 0 {
            let (color, language) = (&arrays.color.geometry, &arrays.language.geometry);
            let geometry = (&arrays.means.values, &color.values, &language.values);
            tools.densify.split(&mut mover.recorder, seed, &source, geometry);
        }
        mover.recorder.submit();
        self.len = total;
        Ok(done)
    }

    fn tools(&mut self) -> Result<Arc<Tools>, GpuError> {
        self.gpu.check()?;
        if let Some(tools) = &self.tools {
            return Ok(tools.clone());
        }
        let tools = Arc::new(Tools::new(&self.gpu)?);
        self.tools = Some(tools.clone());
        Ok(tools)
    }
}
