//! The renderer: pictures of color, depth and language from any camera. Training steps are in
//! `step.rs`.
//!
//! If a list overflowed, the lists grow and the picture is made again: there is never a picture from
//! a list that was cut short.

use crate::adam::Adam;
use crate::buffer::{Buffer, read_bytes};
use crate::camera::Camera;
use crate::device::Gpu;
use crate::error::{GpuError, expect_len};
use crate::gaussians::{Arrays, Gaussians, MAX_CHANNELS};
use crate::kernel::Recorder;
use crate::layout::{PixelState, Row, rows_for};
use crate::loss::Loss;
use crate::pass::{Lister, Pass};
use crate::reduce::Reduce;
use crate::step::{Ledger, RESULT_ROWS};
use crate::tally::Tally;
use crate::target::unpad_rows;
use crate::ties::{Tie, Ties};

/// Hits that fit before the first growth.
const FIRST_HIT_CAPACITY: usize = 1 << 16;

/// A pixel with less light left takes little more.
const FULL_TRANSMITTANCE: f32 = 5e-3;

/// A rendered view, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Red, green, blue over black; height x width x 3.
    pub rgb: Vec<f32>,
    /// Blended z in metres, not divided by opacity; height x width.
    pub depth: Vec<f32>,
    /// One minus the light that passes; height x width.
    pub opacity: Vec<f32>,
}

/// Rendered language codes, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct LanguageImage {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Length of a code.
    pub channels: usize,
    /// Blended codes, not divided by opacity; height x width x channels.
    pub codes: Vec<f32>,
    /// One minus the light that passes the language head; height x width.
    pub opacity: Vec<f32>,
}

/// How much work a color picture is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Workload {
    /// Gaussians that the view sees.
    pub visible: usize,
    /// (Gaussian, tile) pairs.
    pub hits: usize,
    /// Gaussians evaluated at pixels: a tile's list up to where its last pixel is full, times the
    /// tile's pixels.
    pub evaluations: u64,
}

/// A rendered view on the device, until the renderer is used again.
#[derive(Clone, Copy)]
pub struct Drawn<'a> {
    /// Red, green, blue over black and blended z in metres, not divided by opacity; height x width.
    pub image: &'a Buffer<Row>,
    /// Light that passes; height x width.
    pub pixels: &'a Buffer<PixelState>,
}

/// What one Gaussian gave to a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Contribution {
    /// Sum over pixels of its blending weight.
    pub weight: f32,
    /// Pixels that it reaches with more than half of the light left behind it.
    pub touched_pixels: f32,
}

/// Pipelines and scratch buffers for one map or one reader.
pub struct Renderer {
    pub(crate) gpu: Gpu,
    pub(crate) channels: usize,
    pub(crate) lister: Lister,
    pub(crate) color: Pass,
    pub(crate) language: Pass,
    pub(crate) loss: Loss,
    pub(crate) reduce: Reduce,
    pub(crate) adam: Adam,
    pub(crate) tie: Tie,
    pub(crate) tally: Tally,
    pub(crate) ties: Ties,
    pub(crate) results: Buffer<Row>,
    pub(crate) ledger: Ledger,
}

/// The cameras of the heads that a pass renders.
#[derive(Clone, Copy)]
pub(crate) struct Cameras<'a> {
    pub(crate) color: Option<&'a Camera>,
    pub(crate) language: Option<&'a Camera>,
}

impl Renderer {
    /// Compiles all kernels for language codes of `language_channels` values.
    ///
    /// # Errors
    /// [`GpuError::BadValue`] unless there are 1 to [`MAX_CHANNELS`] channels; as
    /// [`crate::kernel::Kernel::new`].
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
        Ok(Self {
            gpu: gpu.clone(),
            channels,
            lister: Lister::new(gpu)?,
            color: Pass::new(gpu, 1, true, hits.max(1))?,
            language: Pass::new(gpu, rows_for(channels), false, hits.max(1))?,
            loss: Loss::new(gpu)?,
            reduce: Reduce::new(gpu)?,
            adam: Adam::new(gpu)?,
            tie: Tie::new(gpu)?,
            tally: Tally::new(gpu)?,
            ties: Ties::default(),
            results: Buffer::new(gpu, "results", RESULT_ROWS)?,
            ledger: Ledger::default(),
        })
    }

    /// Ties parameters of the two heads together from the next step on.
    pub fn set_ties(&mut self, ties: Ties) {
        self.ties = ties;
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
        let (rows, opacity) = self.render(gaussians, camera, true)?;
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
        let (rows, opacity) = self.render(gaussians, camera, false)?;
        Ok(LanguageImage {
            width: camera.width,
            height: camera.height,
            channels: self.channels,
            codes: unpad_rows(&rows, self.channels),
            opacity,
        })
    }

    /// What each Gaussian gives to the color picture of a camera.
    ///
    /// # Errors
    /// As [`Renderer::render_color`].
    pub fn contributions(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
    ) -> Result<Vec<Contribution>, GpuError> {
        self.render(gaussians, camera, true)?;
        if gaussians.is_empty() {
            return Ok(Vec::new());
        }
        let found = self.color.contributions(&self.gpu, self.lister.ranks())?;
        Ok(found
            .into_iter()
            .map(|[weight, touched_pixels]| Contribution { weight, touched_pixels })
            .collect())
    }

    /// Bytes of scratch on the device.
    pub fn device_bytes(&self) -> u64 {
        self.lister.device_bytes() + self.color.device_bytes() + self.language.device_bytes()
    }

    /// Makes room for a pass over both or one of the heads.
    pub(crate) fn reserve(
        &mut self,
        gaussians: &Gaussians,
        cameras: Cameras<'_>,
        training: bool,
    ) -> Result<(), GpuError> {
        self.lister.reserve(&self.gpu, gaussians)?;
        for (camera, pass) in
            [(cameras.color, &mut self.color), (cameras.language, &mut self.language)]
        {
            if let Some(camera) = camera {
                pass.reserve(&self.gpu, &self.lister.sort, (gaussians, camera), training)?;
            }
        }
        Ok(())
    }

    /// Records the forward pass: project, rank once, then lists and blend of each head.
    pub(crate) fn draw(
        &mut self,
        recorder: &mut Recorder<'_>,
        (arrays, count): (&Arrays, usize),
        cameras: Cameras<'_>,
    ) {
        let tiling = self.gpu.tiling();
        let means = &arrays.means;
        for (camera, pass, head) in [
            (cameras.color, &mut self.color, &arrays.color),
            (cameras.language, &mut self.language, &arrays.language),
        ] {
            if let Some(camera) = camera {
                let arguments = camera.arguments(tiling, (count, pass.hit_capacity()));
                pass.project(recorder, (means, head), arguments);
            }
        }
        let heads: Vec<(&Pass, _)> = [
            cameras.color.map(|_| (&self.color, &arrays.color)),
            cameras.language.map(|_| (&self.language, &arrays.language)),
        ]
        .into_iter()
        .flatten()
        .collect();
        let passes: Vec<&Pass> = heads.iter().map(|(pass, _)| *pass).collect();
        self.lister.rank(recorder, &passes, count);
        for (pass, head) in heads {
            pass.blend(recorder, &self.lister, head);
        }
    }

    /// Renders color, depth and opacity and leaves them on the device; nothing for an empty map.
    ///
    /// # Errors
    /// As [`Renderer::render_color`].
    pub fn draw_color(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
    ) -> Result<Option<Drawn<'_>>, GpuError> {
        if !self.draw_whole(gaussians, camera, true)? {
            return Ok(None);
        }
        Ok(Some(Drawn { image: self.color.image(), pixels: self.color.pixels() }))
    }

    /// How much work the color picture of a camera is.
    ///
    /// # Errors
    /// As [`Renderer::render_color`].
    pub fn workload(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
    ) -> Result<Workload, GpuError> {
        if !self.draw_whole(gaussians, camera, true)? {
            return Ok(Workload::default());
        }
        let tiling = self.gpu.tiling();
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
            visible: self.lister.ranks().visible.read(&self.gpu, 1)?[0].count as usize,
            hits: self.color.hit_count().read(&self.gpu, 1)?[0].drawn as usize,
            evaluations: evaluated.sum::<u64>() * u64::from(width * height),
        })
    }

    /// Draws one head from lists that hold all hits; false for an empty map.
    fn draw_whole(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
        color: bool,
    ) -> Result<bool, GpuError> {
        check_camera(camera)?;
        expect_len("language_channels", self.channels, gaussians.language_channels())?;
        let Some(arrays) = gaussians.arrays().filter(|_| !gaussians.is_empty()) else {
            return Ok(false);
        };
        let (color_camera, language) = (color.then_some(camera), (!color).then_some(camera));
        let cameras = Cameras { color: color_camera, language };
        let gpu = self.gpu.clone();
        loop {
            self.reserve(gaussians, cameras, false)?;
            let mut recorder = Recorder::new(&gpu)?;
            self.draw(&mut recorder, (arrays, gaussians.len()), cameras);
            recorder.submit();
            let pass = if color { &mut self.color } else { &mut self.language };
            let count = pass.hit_count().read(&gpu, 1)?[0];
            if !pass.outgrown(count) {
                return Ok(true);
            }
        }
    }

    fn render(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
        color: bool,
    ) -> Result<(Vec<Row>, Vec<f32>), GpuError> {
        let rows = if color { 1 } else { rows_for(self.channels) };
        let pixels = camera.pixels();
        if !self.draw_whole(gaussians, camera, color)? {
            return Ok((vec![[0.0; 4]; rows * pixels], vec![0.0; pixels]));
        }
        let pass = if color { &self.color } else { &self.language };
        let (image, states) = (rows * pixels * size_of::<Row>(), pixels * size_of::<PixelState>());
        let parts: [(&wgpu::Buffer, u64); 2] =
            [(pass.image(), image as u64), (pass.pixels(), states as u64)];
        let bytes = read_bytes(&self.gpu, &parts)?;
        let (image, states) = bytes.split_at(image);
        let states: Vec<PixelState> = bytemuck::pod_collect_to_vec(states);
        let opacity = states.iter().map(|state| 1.0 - state.transmittance).collect();
        Ok((bytemuck::pod_collect_to_vec(image), opacity))
    }
}

pub(crate) fn check_camera(camera: &Camera) -> Result<(), GpuError> {
    let pose = camera.camera_from_world.to_homogeneous();
    let finite = [camera.cx, camera.cy].iter().chain(pose.iter()).all(|value| value.is_finite());
    let focal = [camera.fx, camera.fy].iter().all(|f| f.is_finite() && *f > 0.0);
    let size = camera.width > 0 && camera.height > 0;
    if finite && focal && size {
        return Ok(());
    }
    let expected = "a finite pose, positive focal lengths and at least one pixel";
    Err(GpuError::BadValue { what: "camera", expected, found: format!("{camera:?}") })
}
