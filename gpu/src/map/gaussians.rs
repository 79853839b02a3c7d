//! The map on the device: one mean and two heads per Gaussian, and the moments of the optimiser.
//!
//! Color and language share the mean and nothing else (disentanglement; the paper, section 4.3).

use std::sync::Arc;

use nalgebra::Isometry3;

use crate::device::{Gpu, GpuError, expect_len, largest_binding};
use crate::map::arrays;
use crate::map::arrays::{Arrays, MapSlice, Purpose, READ_GAUSSIANS, Room};
use crate::map::host::{HostGaussians, HostHead};
use crate::map::motion;
use crate::map::rows::pad_rows;
use crate::map::tools::Tools;
use crate::shader::layout::Row;

/// Most channels of a feature.
pub const MAX_CHANNELS: usize = 64;

/// Most Gaussians of a map.
const MAX_GAUSSIANS: u64 = (1 << 30) - 1;

/// Gaussians that the first allocation makes room for, at least.
const FIRST_CAPACITY: usize = 1024;

/// A map on the device.
pub struct Gaussians {
    pub(super) gpu: Gpu,
    pub(super) len: usize,
    capacity: usize,
    pub(super) channels: usize,
    /// Owner of the Gaussians that are appended next.
    pub(super) owner: u32,
    purpose: Purpose,
    pub(super) arrays: Option<Arrays>,
    pub(super) tools: Option<Arc<Tools>>,
}

impl Gaussians {
    /// An empty map whose language codes have `language_channels` values, 1 to [`MAX_CHANNELS`].
    pub fn new(gpu: &Gpu, language_channels: usize) -> Self {
        Self::made_for(Purpose::Training, gpu, language_channels)
    }

    /// As [`Gaussians::new`], for pictures alone: without moments it takes a third of the memory, and a
    /// trainer refuses it.
    pub fn for_drawing(gpu: &Gpu, language_channels: usize) -> Self {
        Self::made_for(Purpose::Drawing, gpu, language_channels)
    }

    fn made_for(purpose: Purpose, gpu: &Gpu, channels: usize) -> Self {
        let gpu = gpu.clone();
        Self { gpu, len: 0, capacity: 0, channels, owner: 0, purpose, arrays: None, tools: None }
    }

    /// Returns an error for a map that is made for pictures alone.
    pub(crate) fn check_trainable(&self) -> Result<(), GpuError> {
        if self.purpose == Purpose::Training {
            return Ok(());
        }
        let (what, expected) = ("map", "one that can be trained");
        Err(GpuError::BadValue { what, expected, found: "one for drawing".to_owned() })
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True if there is none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Length of a language code.
    pub fn language_channels(&self) -> usize {
        self.channels
    }

    /// Sets the owner of the Gaussians that are appended from now on, 0 at first; see
    /// [`Gaussians::move_with_owners`].
    ///
    /// # Errors
    /// [`GpuError::BadValue`] above 2^24.
    pub fn set_owner(&mut self, owner: u32) -> Result<(), GpuError> {
        if owner > motion::MAX_OWNER {
            let (what, expected) = ("owner", "at most 2^24");
            return Err(GpuError::BadValue { what, expected, found: owner.to_string() });
        }
        self.owner = owner;
        Ok(())
    }

    /// Moves every Gaussian by its owner's motion, `moved_from_world`: its mean, and the rotations
    /// of both heads. Moments and step counts stay. An owner without a motion stays where it is.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn move_with_owners(
        &mut self,
        motion: impl Fn(u32) -> Option<Isometry3<f64>>,
    ) -> Result<(), GpuError> {
        let Some(MapSlice { arrays, count }) = self.slice() else { return Ok(()) };
        let mut means = arrays.means.values.read(&self.gpu, count)?;
        let motions: Vec<_> = means.iter().map(|mean| motion(motion::owner(mean))).collect();
        for (mean, motion) in means.iter_mut().zip(&motions) {
            motion.iter().for_each(|motion| motion::move_mean(mean, motion));
        }
        arrays.means.values.write(&self.gpu, 0, &means);
        for head in [&arrays.color, &arrays.language] {
            let mut geometry = head.geometry.values.read(&self.gpu, head.geometry.rows * count)?;
            let rotations = geometry.iter_mut().step_by(head.geometry.rows);
            for (rotation, motion) in rotations.zip(&motions) {
                motion.iter().for_each(|motion| motion::turn(rotation, motion));
            }
            head.geometry.values.write(&self.gpu, 0, &geometry);
        }
        Ok(())
    }

    /// Appends Gaussians, with moments and step counts of zero. The others keep theirs.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`] when lengths disagree, [`GpuError::OutOfMemory`]; the map is
    /// then as it was.
    pub fn append(&mut self, more: &HostGaussians) -> Result<(), GpuError> {
        more.check(self.channels)?;
        if more.is_empty() {
            return Ok(());
        }
        self.gpu.check()?;
        self.reserve(self.len + more.len())?;
        let arrays = self.arrays.as_ref().expect("reserved above");
        let owner = self.owner as f32;
        let means: Vec<Row> = more.means.iter().map(|m| [m[0], m[1], m[2], owner]).collect();
        let mut encoder = self.gpu.device().create_command_encoder(&Default::default());
        arrays.means.write(&self.gpu, &mut encoder, self.len, &means);
        arrays.color.write(&self.gpu, &mut encoder, self.len, &more.color);
        arrays.language.write(&self.gpu, &mut encoder, self.len, &more.language);
        self.gpu.queue().submit([encoder.finish()]);
        self.len += more.len();
        Ok(())
    }

    /// Reads the parameters back.
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn to_host(&self) -> Result<HostGaussians, GpuError> {
        let Some(arrays) = &self.arrays else {
            let head = |channels| HostHead { channels, ..HostHead::default() };
            let (color, language) = (head(3), head(self.channels));
            return Ok(HostGaussians { means: Vec::new(), color, language });
        };
        Ok(HostGaussians {
            means: self.read_means()?,
            color: arrays.color.read(&self.gpu, self.len, 3)?,
            language: arrays.language.read(&self.gpu, self.len, self.channels)?,
        })
    }

    /// Reads the centres back, metres; a small part of [`Gaussians::to_host`].
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn read_means(&self) -> Result<Vec<[f32; 3]>, GpuError> {
        let Some(arrays) = &self.arrays else { return Ok(Vec::new()) };
        let mut means = Vec::with_capacity(self.len);
        arrays.means.values.read_some(&self.gpu, self.len, READ_GAUSSIANS, |rows| {
            means.extend(rows.iter().map(|m| [m[0], m[1], m[2]]));
        })?;
        Ok(means)
    }

    /// Reads the language codes back, `len` x channels; a part of [`Gaussians::to_host`].
    ///
    /// # Errors
    /// [`GpuError::DeviceLost`].
    pub fn read_language_features(&self) -> Result<Vec<f32>, GpuError> {
        let Some(arrays) = &self.arrays else { return Ok(Vec::new()) };
        arrays.language.read_features(&self.gpu, self.len, self.channels)
    }

    /// Replaces all language codes (`len` x channels) and starts their moments afresh.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`].
    pub fn set_language_features(&mut self, features: &[f32]) -> Result<(), GpuError> {
        expect_len("features", self.len * self.channels, features.len())?;
        self.set_language_features_from(0, features)
    }

    /// Replaces the language codes of the Gaussians from index `start` on, as many as `features`
    /// (count x channels) has, and starts their moments afresh.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`] for a part of a code, [`GpuError::BadValue`] for codes of
    /// Gaussians that are not there.
    pub fn set_language_features_from(
        &mut self,
        start: usize,
        features: &[f32],
    ) -> Result<(), GpuError> {
        let count = features.len() / self.channels.max(1);
        expect_len("features", count * self.channels, features.len())?;
        if start > self.len || count > self.len - start {
            let (what, expected) = ("start", "codes of gaussians that are there");
            let found = format!("{count} from {start} of {}", self.len);
            return Err(GpuError::BadValue { what, expected, found });
        }
        if let Some(arrays) = &self.arrays {
            let rows = pad_rows(features, self.channels);
            let mut encoder = self.gpu.device().create_command_encoder(&Default::default());
            arrays.language.features.write(&self.gpu, &mut encoder, start, &rows);
            self.gpu.queue().submit([encoder.finish()]);
        }
        Ok(())
    }

    /// Bytes on the device.
    pub fn device_bytes(&self) -> u64 {
        let arrays = self.arrays.as_ref().map(Arrays::all).unwrap_or_default();
        arrays.iter().map(|array| array.buffer.size()).sum()
    }

    /// The arrays and how much of them is in use; `None` for an empty map.
    pub(crate) fn slice(&self) -> Option<MapSlice<'_>> {
        let arrays = self.arrays.as_ref().filter(|_| self.len > 0)?;
        Some(MapSlice { arrays, count: self.len })
    }

    /// Number of Gaussians that fit without a new allocation.
    pub(crate) fn capacity(&self) -> usize {
        self.capacity
    }

    /// Makes room for `len` Gaussians, array by array: at the peak one array is there twice.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`]; the map is then as it was.
    pub fn reserve(&mut self, len: usize) -> Result<(), GpuError> {
        if len <= self.capacity {
            return Ok(());
        }
        let widest = arrays::widest_bytes(self.channels) as u64;
        let most = (largest_binding(&self.gpu) / widest).min(MAX_GAUSSIANS);
        if len as u64 > most {
            let bytes = (len as u64).saturating_mul(widest);
            let reason = format!("the adapter holds at most {most} gaussians of this kind");
            return Err(GpuError::OutOfMemory { label: "gaussians".to_owned(), bytes, reason });
        }
        let roomy = (self.capacity + self.capacity / 2).max(FIRST_CAPACITY);
        let capacity = len.max(roomy.min(most as usize));
        match &mut self.arrays {
            Some(arrays) => {
                arrays.grow(&arrays::Growth { gpu: &self.gpu, len: self.len, capacity })?;
            }
            None => {
                let room = Room { gpu: &self.gpu, capacity, purpose: self.purpose };
                self.arrays = Some(Arrays::new(room, self.channels)?);
            }
        }
        self.capacity = capacity;
        Ok(())
    }
}
