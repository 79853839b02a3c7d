//! Tells readers that the map has changed, and copies it for those who want it.

use super::super::evidence::{Evidence, LanguageView};
use super::super::keyframes::Keyframe;
use super::super::live_map::LiveMap;
use super::super::map::Map;
use super::super::mapper::Clock;
use super::super::snapshot::{KeyframeInfo, MapSnapshot};
use super::super::up::MapUp;
use crate::telemetry::{SNAPSHOT_SECONDS, timed};
use lexsplat_gpu::{GpuError, HostGaussians, Trainer};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Remembers what readers were told, and what they have.
pub(super) struct Publisher {
    /// Whether steps in flight are waited for though nobody reads.
    always_settles: bool,
    /// The Gaussians of the newest copy.
    copied: Arc<HostGaussians>,
    /// Revision of the newest copy; `None` before the first.
    copied_revision: Option<u64>,
    gaussians_changed: bool,
    poses_changed: bool,
    told_at: Instant,
    /// The direction up when readers were told last.
    up: Option<MapUp>,
}

impl Publisher {
    /// With the clock `per_frame` the map must not depend on readers: when it has changed, steps are waited
    /// for whether a copy is made or not.
    pub fn new(clock: Clock) -> Self {
        Self {
            always_settles: clock == Clock::PerFrame,
            copied: Arc::default(),
            copied_revision: None,
            gaussians_changed: false,
            poses_changed: false,
            told_at: Instant::now(),
            up: None,
        }
    }

    /// Gaussians or the online compressor differ from what readers were told of.
    pub fn gaussians_changed(&mut self) {
        self.gaussians_changed = true;
    }

    /// The trajectory or the set of keyframes differs from what readers were told of.
    pub fn poses_changed(&mut self) {
        self.poses_changed = true;
    }

    /// Time since readers were told of a change.
    pub fn age(&self) -> Duration {
        self.told_at.elapsed()
    }

    /// Tells readers what has changed, if anything, and makes a copy if one is due, for which it waits for
    /// the optimiser steps in flight.
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
        if self.gaussians_changed && self.always_settles {
            trainer.settle(&mut live.gaussians)?;
        }
        self.tell_changes(live, map);
        if !map.copies().is_due() {
            return Ok(());
        }
        timed(SNAPSHOT_SECONDS, || {
            trainer.settle(&mut live.gaussians)?;
            self.copy(live, map, through)
        })
    }

    /// Makes the last copy, for those who still have the map when its thread ends. After an error the device
    /// may have steps that it cannot take; the map is shown without them.
    ///
    /// # Errors
    /// As [`Publisher::publish`].
    pub fn end(
        &mut self,
        live: &mut LiveMap,
        trainer: &mut Trainer,
        map: &Map,
        through: Option<u64>,
    ) -> Result<(), GpuError> {
        let settled = trainer.settle(&mut live.gaussians);
        self.tell_changes(live, map);
        let copied =
            if map.copies().is_outdated() { self.copy(live, map, through) } else { Ok(()) };
        settled.and(copied)
    }

    fn tell_changes(&mut self, live: &mut LiveMap, map: &Map) {
        live.revision += u64::from(self.gaussians_changed);
        if self.gaussians_changed || self.poses_changed {
            self.tell(live, map);
        }
    }

    /// Tells readers of the map as it is.
    pub fn tell(&mut self, live: &LiveMap, map: &Map) {
        self.up = live.up();
        map.tell_change(live, self.up);
        (self.gaussians_changed, self.poses_changed) = (false, false);
        self.told_at = Instant::now();
    }

    /// Gives readers the map as it is, after the frame `through`. They were told of it.
    fn copy(&mut self, live: &LiveMap, map: &Map, through: Option<u64>) -> Result<(), GpuError> {
        map.copies().begin();
        if self.copied_revision != Some(live.revision) {
            self.copied = Arc::new(live.gaussians.to_host()?);
            self.copied_revision = Some(live.revision);
        }
        let views = live.keyframes.iter().filter_map(language_view).collect();
        map.publish(MapSnapshot {
            map: map.name().to_owned(),
            revision: live.revision,
            through,
            gaussians: self.copied.clone(),
            online: Arc::from(live.online.boxed_clone()),
            trajectory: Arc::new(live.trajectory.frames(&live.keyframes)),
            keyframes: Arc::new(live.keyframes.iter().map(info).collect()),
            evidence: Arc::new(Evidence::new(views)),
            up: self.up,
        });
        Ok(())
    }
}

fn language_view(keyframe: &Keyframe) -> Option<LanguageView> {
    let language = keyframe.language.as_ref()?;
    Some(LanguageView {
        image: keyframe.training.clone(),
        camera: language.camera.clone(),
        codes: language.codes.clone(),
    })
}

fn info(keyframe: &Keyframe) -> KeyframeInfo {
    KeyframeInfo {
        frame: keyframe.frame,
        intrinsics: keyframe.intrinsics,
        rgb: keyframe.rgb.clone(),
        has_language: keyframe.language.is_some(),
    }
}
