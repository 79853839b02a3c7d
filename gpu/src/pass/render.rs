//! Renders color, depth and language codes from any camera.
//!
//! The lists of hits have a capacity. If a view overflows them, they grow and the view is rendered
//! again, so an image is never made from incomplete lists. Where they cannot grow, the view is cut
//! into bands.

use crate::device::{Gpu, GpuError, expect_len};
use crate::map::rows::unpad_rows;
use crate::map::{Gaussians, HeadKind, MAX_CHANNELS, MapSlice};
use crate::pass::binning::Binning;
use crate::pass::camera::Camera;
use crate::pass::head::HeadPass;
use crate::pass::image::{ColorImage, Contribution, Drawn, LanguageImage, Workload};
use crate::shader::layout::{HitCount, PixelState, Row};
use crate::shader::{Recorder, Tiling};

/// Hits that fit before the first growth.
const FIRST_HIT_CAPACITY: usize = 1 << 16;

/// Transmittance below which a pixel counts as full in [`Renderer::workload`].
const FULL_TRANSMITTANCE: f32 = 5e-3;

/// The kernels and scratch buffers of the splatting pass, for one map at a time.
pub struct Renderer {
    pub(super) gpu: Gpu,
    pub(super) channels: usize,
    binning: Binning,
    color: HeadPass,
    language: HeadPass,
}

/// The camera of each head that a pass renders.
#[derive(Clone, Copy)]
pub(crate) struct HeadCameras<'a> {
    pub(crate) color: Option<&'a Camera>,
    pub(crate) language: Option<&'a Camera>,
}

impl<'a> HeadCameras<'a> {
    /// One head alone.
    pub(super) fn only(head: HeadKind, camera: &'a Camera) -> Self {
        match head {
            HeadKind::Color => Self { color: Some(camera), language: None },
            HeadKind::Language => Self { color: None, language: Some(camera) },
        }
    }
}

impl Renderer {
    /// Compiles all kernels for language codes of `language_channels` values.
    ///
    /// # Errors
    /// [`GpuError::BadValue`] unless there are 1 to [`MAX_CHANNELS`] channels; as
    /// [`crate::shader::Kernel::new`].
    pub fn new(gpu: &Gpu, language_channels: usize) -> Result<Renderer, GpuError> {
        Self::with_hit_capacity(gpu, language_channels, FIRST_HIT_CAPACITY)
    }

    /// As [`Renderer::new`], with lists for `hits` hits at first.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn with_hit_capacity(gpu: &Gpu, channels: usize, hits: usize) -> Result<Self, GpuError> {
        if !(1..=MAX_CHANNELS).contains(&channels) {
            let found = channels.to_string();
            let (what, expected) = ("language_channels", "1 to 64");
            return Err(GpuError::BadValue { what, expected, found });
        }
        let hits = hits.max(1);
        Ok(Self {
            gpu: gpu.clone(),
            channels,
            binning: Binning::new(gpu)?,
            color: HeadPass::new(gpu, HeadKind::Color, channels, hits)?,
            language: HeadPass::new(gpu, HeadKind::Language, channels, hits)?,
        })
    }

    /// Renders color, depth and opacity.
    ///
    /// # Errors
    /// [`GpuError::BadValue`] for a camera that cannot be used, [`GpuError::OutOfMemory`],
    /// [`GpuError::DeviceLost`].
    pub fn render_color(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
    ) -> Result<ColorImage, GpuError> {
        let (rows, opacity) = self.render(gaussians, camera, HeadKind::Color)?;
        Ok(ColorImage {
            width: camera.width,
            height: camera.height,
            rgb: rows.iter().flat_map(|row| [row[0], row[1], row[2]]).collect(),
            depth: rows.iter().map(|row| row[3]).collect(),
            opacity,
        })
    }

    /// Renders language codes and their opacity.
    ///
    /// # Errors
    /// As [`Renderer::render_color`].
    pub fn render_language(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
    ) -> Result<LanguageImage, GpuError> {
        let (rows, opacity) = self.render(gaussians, camera, HeadKind::Language)?;
        Ok(LanguageImage {
            width: camera.width,
            height: camera.height,
            channels: self.channels,
            codes: unpad_rows(&rows, self.channels),
            opacity,
        })
    }

    /// Renders color, depth and opacity and leaves them on the device; `None` for an empty map.
    ///
    /// # Errors
    /// As [`Renderer::render_color`].
    pub fn draw_color(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
    ) -> Result<Option<Drawn<'_>>, GpuError> {
        if !self.draw(gaussians, camera, HeadKind::Color)? {
            return Ok(None);
        }
        Ok(Some(Drawn { image: self.color.image(), pixels: self.color.pixels() }))
    }

    /// What each Gaussian contributes to the color image of a camera, in the order of the map.
    ///
    /// # Errors
    /// As [`Renderer::render_color`].
    pub fn contributions(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
    ) -> Result<Vec<Contribution>, GpuError> {
        if !self.draw(gaussians, camera, HeadKind::Color)? {
            return Ok(Vec::new());
        }
        let found = self.color.contributions(&self.gpu, &self.binning)?;
        Ok(found
            .into_iter()
            .map(|[weight, touched_pixels]| Contribution { weight, touched_pixels })
            .collect())
    }

    /// Counts the work of the color image of a camera.
    ///
    /// # Errors
    /// As [`Renderer::render_color`].
    pub fn workload(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
    ) -> Result<Workload, GpuError> {
        if !self.draw(gaussians, camera, HeadKind::Color)? {
            return Ok(Workload::default());
        }
        let tiling = Tiling::of(self.gpu.tier());
        let [columns, rows] = camera.tiles(tiling);
        let [width, height] = tiling.size();
        let ranges = self.color.ranges().read(&self.gpu, (columns * rows) as usize)?;
        let pixels = self.color.pixels().read(&self.gpu, camera.pixels())?;
        let mut ends: Vec<(u32, f32)> = vec![(0, 0.0); ranges.len()];
        for (at, pixel) in pixels.iter().enumerate() {
            let (x, y) = (at as u32 % camera.width, at as u32 / camera.width);
            let (last, lightest) = &mut ends[(y / height * columns + x / width) as usize];
            *last = pixel.last.max(*last);
            *lightest = pixel.transmittance.max(*lightest);
        }
        let evaluated = ranges.iter().zip(&ends).map(|([first, end], (last, lightest))| {
            let end = if *lightest < FULL_TRANSMITTANCE { *last } else { *end };
            u64::from(end.saturating_sub(*first))
        });
        Ok(Workload {
            visible: self.binning.ranks().visible.read(&self.gpu, 1)?[0].count as usize,
            hits: ranges.iter().map(|[first, end]| (end - first) as usize).sum(),
            evaluations: evaluated.sum::<u64>() * u64::from(width * height),
        })
    }

    /// Makes lists hold at most `hits` hits, instead of as many as the device can bind. A picture
    /// with more is drawn band by band.
    pub fn limit_lists(&mut self, hits: usize) {
        self.color.limit_lists(hits);
        self.language.limit_lists(hits);
    }

    /// Bytes of scratch on the device.
    pub fn device_bytes(&self) -> u64 {
        self.binning.device_bytes() + self.color.device_bytes() + self.language.device_bytes()
    }

    pub(crate) fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Length of a language code.
    pub(crate) fn channels(&self) -> usize {
        self.channels
    }

    pub(crate) fn binning(&self) -> &Binning {
        &self.binning
    }

    pub(crate) fn head(&self, head: HeadKind) -> &HeadPass {
        match head {
            HeadKind::Color => &self.color,
            HeadKind::Language => &self.language,
        }
    }

    pub(crate) fn head_mut(&mut self, head: HeadKind) -> &mut HeadPass {
        match head {
            HeadKind::Color => &mut self.color,
            HeadKind::Language => &mut self.language,
        }
    }

    /// Makes room for a pass over the heads that have a camera, and for the way back if `backward`
    /// is set.
    pub(crate) fn reserve(
        &mut self,
        gaussians: &Gaussians,
        cameras: HeadCameras<'_>,
        backward: bool,
    ) -> Result<(), GpuError> {
        let Self { gpu, binning, color, language, .. } = self;
        binning.reserve(gpu, gaussians)?;
        for (camera, pass) in [(cameras.color, color), (cameras.language, language)] {
            if let Some(camera) = camera {
                pass.reserve(gpu, &binning.sort, gaussians, camera, backward)?;
            }
        }
        Ok(())
    }

    /// Records the forward pass of the heads that have a camera: project each, order once for both,
    /// then bin and blend each.
    pub(crate) fn record_forward(
        &mut self,
        recorder: &mut Recorder<'_>,
        map: MapSlice<'_>,
        cameras: HeadCameras<'_>,
    ) {
        let tiling = Tiling::of(self.gpu.tier());
        for (camera, pass) in
            [(cameras.color, &mut self.color), (cameras.language, &mut self.language)]
        {
            if let Some(camera) = camera {
                let arguments = camera.arguments(tiling, map.count, pass.list_capacity());
                pass.project(recorder, map.arrays, arguments);
            }
        }
        let color = cameras.color.map(|_| &self.color);
        let language = cameras.language.map(|_| &self.language);
        let (Some(first), Some(last)) = (color.or(language), language.or(color)) else { return };
        self.binning.rank(recorder, [first.projected(), last.projected()], map.count);
        for pass in [color, language].into_iter().flatten() {
            pass.blend(recorder, &self.binning, map.arrays);
        }
    }

    /// Draws one head from complete lists; false for an empty map.
    fn draw(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
        head: HeadKind,
    ) -> Result<bool, GpuError> {
        camera.check()?;
        expect_len("language_channels", self.channels, gaussians.language_channels())?;
        let Some(map) = gaussians.slice() else { return Ok(false) };
        let cameras = HeadCameras::only(head, camera);
        let gpu = self.gpu.clone();
        loop {
            self.reserve(gaussians, cameras, false)?;
            let mut recorder = Recorder::new(&gpu)?;
            self.record_forward(&mut recorder, map, cameras);
            recorder.submit();
            let pass = self.head_mut(head);
            let count: HitCount = pass.hit_count().read(&gpu, 1)?[0];
            if !pass.grow_after(count) {
                return Ok(true);
            }
        }
    }

    /// The rows of the image (height x width x rows) and the opacity (height x width) of one head.
    fn render(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
        head: HeadKind,
    ) -> Result<(Vec<Row>, Vec<f32>), GpuError> {
        let rows = head.rows(self.channels);
        let pixels = camera.pixels();
        if !self.draw(gaussians, camera, head)? {
            return Ok((vec![[0.0; 4]; rows * pixels], vec![0.0; pixels]));
        }
        let pass = self.head(head);
        let (image, states) = (rows * pixels * size_of::<Row>(), pixels * size_of::<PixelState>());
        let parts: [(&wgpu::Buffer, u64); 2] =
            [(pass.image(), image as u64), (pass.pixels(), states as u64)];
        let bytes = self.gpu.read_bytes(&parts)?;
        let (image, states) = bytes.split_at(image);
        let states: Vec<PixelState> = bytemuck::pod_collect_to_vec(states);
        let opacity = states.iter().map(|state| 1.0 - state.transmittance).collect();
        Ok((bytemuck::pod_collect_to_vec(image), opacity))
    }
}
