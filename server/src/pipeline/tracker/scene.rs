//! The map as the tracker sees it. The tracker never changes it.

use super::super::keyframes::KeyframeStore;
use lexsplat_gpu::{Gaussians, Trainer};

/// A map to track in.
pub(in super::super) struct Scene<'a> {
    pub trainer: &'a mut Trainer,
    pub gaussians: &'a Gaussians,
    pub keyframes: &'a KeyframeStore,
}
