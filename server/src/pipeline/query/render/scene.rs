//! The Gaussians of the most recent snapshot on the device.

use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::{
    Camera, ColorImage, Gaussians, Gpu, GpuError, HostGaussians, LanguageImage, Renderer,
};
use std::sync::{Arc, Weak};

/// A renderer with the Gaussians of one snapshot.
pub(crate) struct Scene {
    gpu: Gpu,
    loaded: Option<Loaded>,
}

struct Loaded {
    /// While it is there no other snapshot's Gaussians can have the same address.
    host: Weak<HostGaussians>,
    device: Gaussians,
    renderer: Renderer,
}

impl Scene {
    pub(crate) fn new(gpu: Gpu) -> Self {
        Self { gpu, loaded: None }
    }

    /// Color, depth and opacity of a view.
    pub(crate) fn color(
        &mut self,
        snapshot: &MapSnapshot,
        camera: &Camera,
    ) -> Result<ColorImage, GpuError> {
        let loaded = self.load(snapshot)?;
        loaded.renderer.render_color(&loaded.device, camera)
    }

    /// Codes and opacity of a view.
    pub(crate) fn language(
        &mut self,
        snapshot: &MapSnapshot,
        camera: &Camera,
    ) -> Result<LanguageImage, GpuError> {
        let loaded = self.load(snapshot)?;
        loaded.renderer.render_language(&loaded.device, camera)
    }

    /// For each pixel of a view, the part of what it shows that is of the Gaussians `rows`, 0..1; 0 where it
    /// shows nothing.
    pub(crate) fn share(
        &mut self,
        snapshot: &MapSnapshot,
        camera: &Camera,
        rows: &[u32],
    ) -> Result<Vec<f32>, GpuError> {
        let mut marks = vec![0.0; snapshot.gaussians.len()];
        for &row in rows {
            marks[row as usize] = 1.0;
        }
        self.blended(snapshot, camera, &marks)
    }

    /// For each pixel of a view, the spread of the codes that keyframes have there; 0 where it shows nothing.
    pub(crate) fn spreads(
        &mut self,
        snapshot: &MapSnapshot,
        camera: &Camera,
    ) -> Result<Vec<f32>, GpuError> {
        let sightings = snapshot.sightings().iter();
        let variances: Vec<f32> = sightings.map(|one| one.spread * one.spread).collect();
        let blended = self.blended(snapshot, camera, &variances)?;
        Ok(blended.into_iter().map(|variance| variance.max(0.0).sqrt()).collect())
    }

    /// For each pixel of a view, the mean of a value that each Gaussian has, weighted as language is blended;
    /// 0 where it shows nothing.
    pub(crate) fn blended(
        &mut self,
        snapshot: &MapSnapshot,
        camera: &Camera,
        values: &[f32],
    ) -> Result<Vec<f32>, GpuError> {
        // The arrays of an empty map have no channels.
        if snapshot.gaussians.is_empty() {
            return Ok(vec![0.0; (camera.width * camera.height) as usize]);
        }
        let mut marked = (*snapshot.gaussians).clone();
        let channels = marked.language.channels;
        marked.language.features.fill(0.0);
        let features = marked.language.features.iter_mut().step_by(channels);
        features.zip(values).for_each(|(feature, value)| *feature = *value);
        let mut device = Gaussians::for_drawing(&self.gpu, channels);
        device.append(&marked)?;
        let image = self.load(snapshot)?.renderer.render_language(&device, camera)?;
        let marks = image.codes.iter().step_by(channels).zip(&image.opacity);
        Ok(marks.map(|(mark, opacity)| mark / opacity.max(f32::MIN_POSITIVE)).collect())
    }

    fn load(&mut self, snapshot: &MapSnapshot) -> Result<&mut Loaded, GpuError> {
        let channels = snapshot.online.code_size();
        let kept = self.loaded.take();
        let kept = match kept {
            Some(kept) if kept.host.ptr_eq(&Arc::downgrade(&snapshot.gaussians)) => kept,
            other => {
                let renderer = other
                    .filter(|other| other.device.language_channels() == channels)
                    .map(|other| other.renderer);
                let renderer = match renderer {
                    Some(renderer) => renderer,
                    None => Renderer::new(&self.gpu, channels)?,
                };
                let mut device = Gaussians::for_drawing(&self.gpu, channels);
                device.append(&snapshot.gaussians)?;
                Loaded { host: Arc::downgrade(&snapshot.gaussians), device, renderer }
            }
        };
        Ok(self.loaded.insert(kept))
    }
}
