//! Which color targets are on the device: those of the last steps.
//!
//! A map has hundreds of views and a step needs one of them.

use std::collections::VecDeque;

use crate::device::{Buffer, Gpu, GpuError};
use crate::train::target::ColorTarget;
use crate::train::texels::Texel;

/// Bytes of the targets that stay on the device after their steps.
const KEPT_BYTES: u64 = 16 << 20;
/// Targets that stay in any case: every other step is on the same view.
const KEPT_TARGETS: usize = 2;

/// Targets that are on the device, the one that was used last at the end.
#[derive(Default)]
pub(super) struct TargetsInUse {
    targets: VecDeque<ColorTarget>,
    /// A buffer that no target needs any more.
    spare: Option<Buffer<Texel>>,
}

impl TargetsInUse {
    /// Puts a target on the device, if it is not there, and takes those away that were used longest ago.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`].
    pub(super) fn bring(&mut self, gpu: &Gpu, target: &ColorTarget) -> Result<(), GpuError> {
        let texels = &target.inner().texels;
        if texels.is_resident() {
            return Ok(());
        }
        self.targets.retain(|other| !other.is(target));
        let mut bytes: u64 = self.targets.iter().map(ColorTarget::device_bytes).sum();
        while self.targets.len() >= KEPT_TARGETS && bytes + target.device_bytes() > KEPT_BYTES {
            let Some(oldest) = self.targets.pop_front() else { break };
            bytes -= oldest.device_bytes();
            self.spare = oldest.inner().texels.release().or(self.spare.take());
        }
        if texels.buffer().is_none() {
            texels.upload(gpu, self.spare.take())?;
        }
        self.targets.push_back(target.clone());
        Ok(())
    }
}

impl Drop for TargetsInUse {
    /// Targets may live longer than what used them.
    fn drop(&mut self) {
        for target in &self.targets {
            target.inner().texels.release();
        }
    }
}
