//! Copies the live map for readers.

use super::super::keyframes::Keyframe;
use super::super::live_map::LiveMap;
use super::super::map::Map;
use super::super::snapshot::{KeyframeInfo, MapSnapshot};
use lexsplat_gpu::{GpuError, HostGaussians, Trainer};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Remembers what readers have.
pub(super) struct Publisher {
    /// The Gaussians of the newest snapshot.
    gaussians: Arc<HostGaussians>,
    gaussians_changed: bool,
    poses_changed: bool,
    published_at: Instant,
}

impl Publisher {
    pub fn new() -> Self {
        Self {
            gaussians: Arc::default(),
            gaussians_changed: false,
            poses_changed: false,
            published_at: Instant::now(),
        }
    }

    /// Gaussians or the online compressor differ from the newest snapshot.
    pub fn gaussians_changed(&mut self) {
        self.gaussians_changed = true;
    }

    /// The trajectory or the set of keyframes differs from the newest snapshot.
    pub fn poses_changed(&mut self) {
        self.poses_changed = true;
    }

    pub fn has_changes(&self) -> bool {
        self.gaussians_changed || self.poses_changed
    }

    /// Time since the newest snapshot.
    pub fn age(&self) -> Duration {
        self.published_at.elapsed()
    }

    /// Gives readers the map as it is now, after the frame `through`. Waits for the optimiser steps in
    /// flight.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn publish(
        &mut self,
        live: &mut LiveMap,
        trainer: &mut Trainer,
        map: &Map,
        through: Option<u64>,
    ) -> Result<(), GpuError> {
        if self.gaussians_changed {
            trainer.settle(&mut live.gaussians)?;
            self.gaussians = Arc::new(live.gaussians.to_host()?);
            live.revision += 1;
        }
        self.show(live, map, through);
        Ok(())
    }

    /// Gives readers a map that was put back, with the revision that it had.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn restore(
        &mut self,
        live: &LiveMap,
        map: &Map,
        through: Option<u64>,
    ) -> Result<(), GpuError> {
        self.gaussians = Arc::new(live.gaussians.to_host()?);
        self.show(live, map, through);
        Ok(())
    }

    fn show(&mut self, live: &LiveMap, map: &Map, through: Option<u64>) {
        map.count_contents(live);
        map.publish(MapSnapshot {
            map: map.name().to_owned(),
            revision: live.revision,
            through,
            gaussians: self.gaussians.clone(),
            online: Arc::from(live.online.boxed_clone()),
            trajectory: Arc::new(live.trajectory.frames(&live.keyframes)),
            keyframes: Arc::new(live.keyframes.iter().map(info).collect()),
            up: live.up(),
        });
        (self.gaussians_changed, self.poses_changed) = (false, false);
        self.published_at = Instant::now();
    }
}

fn info(keyframe: &Keyframe) -> KeyframeInfo {
    KeyframeInfo {
        frame: keyframe.frame,
        intrinsics: keyframe.intrinsics,
        rgb: keyframe.rgb.clone(),
        has_language: keyframe.language.is_some(),
    }
}
