//! Removing and reordering Gaussians on the device.
//!
//! Both operations end in a list `source[i]`: the index of the Gaussian that comes to place i. Each
//! array of the map is gathered into one scratch array, as large as the widest of them, and copied
//! back. Everything that can fail comes before the first array moves.

use std::sync::Arc;

use crate::device::{Buffer, Gpu, GpuError};
use crate::map::arrays::{Arrays, widest_bytes};
use crate::map::gaussians::Gaussians;
use crate::map::morton;
use crate::map::prune::{self, PruneBuffers};
use crate::map::tools::Tools;
use crate::shader::Recorder;

/// Everything that moving Gaussians needs, allocated before anything moves.
struct Mover<'a> {
    tools: &'a Tools,
    recorder: Recorder<'a>,
    scratch: Buffer<u32>,
}

impl<'a> Mover<'a> {
    /// Room to move `len` Gaussians with `channels` language channels.
    fn new(gpu: &'a Gpu, tools: &'a Tools, len: usize, channels: usize) -> Result<Self, GpuError> {
        let words = len * widest_bytes(channels) / size_of::<u32>();
        let scratch = Buffer::new(gpu, "scratch of the widest array", words)?;
        Ok(Self { tools, recorder: Recorder::new(gpu)?, scratch })
    }

    /// Records the move of every array to the first `len` entries of `source`.
    fn rearrange(&mut self, arrays: &Arrays, source: &Buffer<u32>, len: usize) {
        for array in arrays.all() {
            let (gather, recorder) = (&self.tools.gather, &mut self.recorder);
            gather.gather(recorder, source, len, array.buffer, &self.scratch, array.width);
            let bytes = (len * array.width * size_of::<u32>()) as u64;
            self.recorder.copy(&self.scratch, array.buffer, 0, bytes);
        }
    }
}

impl Gaussians {
    /// Removes the Gaussians whose opacity is below `min_opacity` in both heads, and those whose
    /// mean or color scale is not a number; see [`crate::map::prune`]. The others keep their order
    /// and their optimiser state. Returns how many were removed.
    ///
    /// # Errors
    /// [`GpuError::BadValue`] unless the opacity is in [0, 1], [`GpuError::OutOfMemory`]; the map is
    /// then as it was.
    pub fn prune(&mut self, min_opacity: f32) -> Result<usize, GpuError> {
        let arguments = prune::arguments(min_opacity, self.len)?;
        let (gpu, tools) = (self.gpu.clone(), self.tools()?);
        let Some(map) = self.slice() else { return Ok(0) };
        let scan = tools.sort.scan();
        let buffers = PruneBuffers::new(&gpu, scan, map.count)?;
        let mut recorder = Recorder::new(&gpu)?;
        tools.prune.record(&mut recorder, scan, &arguments, map.arrays, &buffers);
        recorder.submit();
        let kept = buffers.total.read(&gpu, 1)?[0] as usize;
        let removed = map.count - kept;
        if removed > 0 {
            let mut mover = Mover::new(&gpu, &tools, kept, self.channels)?;
            mover.rearrange(map.arrays, &buffers.source, kept);
            mover.recorder.submit();
            self.len = kept;
        }
        Ok(removed)
    }

    /// Puts the Gaussians in Morton order of their means, so that neighbours in space are
    /// neighbours in memory. Means that are not finite come last. Images do not change, but for
    /// Gaussians at exactly the same depth.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`]; the map is then as it was.
    pub fn reorder_morton(&mut self) -> Result<(), GpuError> {
        let (gpu, tools) = (self.gpu.clone(), self.tools()?);
        let Some(map) = self.slice().filter(|map| map.count > 1) else { return Ok(()) };
        let means = &map.arrays.means.values;
        let Some((low, high)) = tools.morton.bounds(&gpu, means, map.count)? else {
            return Ok(());
        };
        let arguments = morton::arguments(low, high, map.count);
        let buffers = tools.sort.buffers(&gpu, map.count, morton::KEY_BITS)?;
        let count = Buffer::from_slice(&gpu, "gaussian count", &[map.count as u32])?;
        let mut mover = Mover::new(&gpu, &tools, map.count, self.channels)?;
        tools.morton.codes(&mut mover.recorder, &arguments, means, &buffers);
        tools.sort.sort(&mut mover.recorder, &buffers, &count);
        mover.rearrange(map.arrays, &buffers.values[buffers.side()], map.count);
        mover.recorder.submit();
        Ok(())
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
