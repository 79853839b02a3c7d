//! The language of a keyframe: its 32-D codes, and the training target that is made of them when it is used.
//!
//! The 32-D codes of the generic compressor are kept as the truth. The 15-D target belongs to one version
//! of the online stage (paper §4.2). It is on the device for some steps only; made again it is the same.

use super::super::compressor::OnlineStage;
use super::super::encoder::LanguageMap;
use super::codes::Codes;
use half::f16;
use lexsplat_gpu::{Camera, Gpu, GpuError, LanguageTarget};
use std::sync::Arc;

/// Language codes of one keyframe.
pub(in super::super) struct KeyframeLanguage {
    /// The keyframe's camera at the resolution of the codes.
    pub camera: Camera,
    /// `[height * width * 15]`, on the device or not; see [`KeyframeLanguage::refresh_target`].
    pub target: LanguageTarget,
    /// `[height * width * 32]`, row-major. Half precision changes a unit code by less than 0.0005.
    pub codes: Arc<Codes>,
    /// Version of the online stage that encoded the target.
    pub(super) version: u64,
}

impl KeyframeLanguage {
    /// Keeps a language map.
    pub fn new(map: &LanguageMap, camera: Camera) -> Self {
        Self::of_codes(camera, map.codes.iter().copied().map(f16::from_f32).collect())
    }

    /// Codes `[height * width * 32]` of a camera of this size.
    pub(super) fn of_codes(camera: Camera, codes: Vec<f16>) -> Self {
        let target = LanguageTarget::absent(camera.width, camera.height);
        Self { camera, target, codes: Arc::new(Codes::new(codes)), version: 0 }
    }

    /// Makes the target if it is not on the device or the online stage has advanced since.
    ///
    /// # Errors
    /// [`GpuError::OutOfMemory`], [`GpuError::DeviceLost`].
    pub fn refresh_target(&mut self, gpu: &Gpu, online: &dyn OnlineStage) -> Result<(), GpuError> {
        if !self.target.is_on_device() || self.version != online.version() {
            let generic: Vec<f32> = self.codes.all().into_iter().map(f16::to_f32).collect();
            let codes = online.encode(&generic);
            let (width, height) = (self.camera.width, self.camera.height);
            self.target = LanguageTarget::new(gpu, width, height, online.code_size(), &codes)?;
            self.version = online.version();
        }
        Ok(())
    }

    /// Takes the target from the device.
    pub(super) fn release_target(&mut self) {
        self.target = LanguageTarget::absent(self.camera.width, self.camera.height);
    }

    /// Memory of the codes, bytes.
    pub fn bytes(&self) -> u64 {
        self.codes.bytes()
    }
}
