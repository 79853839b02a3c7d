//! The language of a keyframe: its 32-D codes, and the training target that is derived from them.
//!
//! The 32-D codes of the generic compressor are kept as the truth. The 15-D target belongs to one version
//! of the online stage and is derived again when that version has advanced (paper §4.2).

use super::super::compressor::OnlineStage;
use super::super::encoder::LanguageMap;
use half::f16;
use lexsplat_gpu::{Camera, Gpu, GpuError, LanguageTarget};

/// Language codes of one keyframe.
pub(in super::super) struct KeyframeLanguage {
    /// The keyframe's camera at the resolution of the codes.
    pub camera: Camera,
    /// `[height * width * 15]` on the device, see [`KeyframeLanguage::refresh_target`].
    pub target: LanguageTarget,
    /// `[height * width * 32]`, row-major. Half precision changes a unit code by less than 0.0005.
    pub(super) codes: Vec<f16>,
    /// Version of the online stage that encoded the target.
    pub(super) version: u64,
}

impl KeyframeLanguage {
    /// Keeps a language map. `online_codes`: the map encoded by `online`, `[height * width * 15]`.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn new(
        gpu: &Gpu,
        map: &LanguageMap,
        camera: Camera,
        online_codes: &[f32],
        online: &dyn OnlineStage,
    ) -> Result<Self, GpuError> {
        let channels = online.code_size();
        Ok(Self {
            camera,
            target: LanguageTarget::new(gpu, map.width, map.height, channels, online_codes)?,
            codes: map.codes.iter().copied().map(f16::from_f32).collect(),
            version: online.version(),
        })
    }

    /// Encodes the target again if the online stage has advanced since.
    ///
    /// # Errors
    /// As [`KeyframeLanguage::new`].
    pub fn refresh_target(&mut self, gpu: &Gpu, online: &dyn OnlineStage) -> Result<(), GpuError> {
        if self.version != online.version() {
            let generic: Vec<f32> = self.codes.iter().copied().map(f16::to_f32).collect();
            let codes = online.encode(&generic);
            let [width, height] = self.target.size();
            self.target = LanguageTarget::new(gpu, width, height, online.code_size(), &codes)?;
            self.version = online.version();
        }
        Ok(())
    }

    /// Memory on the host and on the device.
    pub fn bytes(&self) -> u64 {
        size_of_val(&self.codes[..]) as u64 + self.target.device_bytes()
    }
}
