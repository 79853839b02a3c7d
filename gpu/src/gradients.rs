//! Gradients of any function of a picture, read back: how the backward pass is proven, and a tool
//! for whoever has a loss of their own. Training does not come by here.

use crate::camera::Camera;
use crate::error::{GpuError, expect_len};
use crate::gaussians::{Gaussians, HostHead};
use crate::kernel::Recorder;
use crate::layout::{HitCount, Row};
use crate::project::MOVE_ROWS;
use crate::render::{Cameras, Renderer, check_camera};
use crate::target::{pad_rows, unpad_rows};

/// dL/dparameters of one head.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeadGradient {
    /// dL/dmean, per metre; empty for language, which does not move means.
    pub means: Vec<[f32; 3]>,
    /// dL/d(rotation, log scale, opacity logit, feature).
    pub head: HostHead,
    /// dL/dtau, tau = (rho, theta) being a left perturbation of `camera_from_world`; zero for
    /// language, which does not move the camera.
    pub pose: [f32; 6],
}

impl Renderer {
    /// Takes dL/d(r, g, b, depth) of each pixel (height x width) to the color head, the means and
    /// the camera.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`] and as [`Renderer::render_color`].
    pub fn color_gradients(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
        d_image: &[Row],
    ) -> Result<HeadGradient, GpuError> {
        expect_len("d_image", camera.pixels(), d_image.len())?;
        self.gradients(gaussians, camera, d_image, true)
    }

    /// Takes dL/dcode of each pixel (height x width x channels) to the language head.
    ///
    /// # Errors
    /// As [`Renderer::color_gradients`].
    pub fn language_gradients(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
        d_codes: &[f32],
    ) -> Result<HeadGradient, GpuError> {
        expect_len("d_codes", camera.pixels() * self.channels, d_codes.len())?;
        self.gradients(gaussians, camera, &pad_rows(d_codes, self.channels), false)
    }

    fn gradients(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
        d_image: &[Row],
        color: bool,
    ) -> Result<HeadGradient, GpuError> {
        check_camera(camera)?;
        let count = gaussians.len();
        let Some(arrays) = gaussians.arrays().filter(|_| count > 0) else {
            return Ok(HeadGradient::default());
        };
        let cameras =
            Cameras { color: color.then_some(camera), language: (!color).then_some(camera) };
        let head = if color { &arrays.color } else { &arrays.language };
        let gpu = self.gpu.clone();
        loop {
            self.reserve(gaussians, cameras, true)?;
            let pass = if color { &self.color } else { &self.language };
            pass.training().image_gradients.write(&gpu, 0, d_image);
            let mut recorder = Recorder::new(&gpu)?;
            self.draw(&mut recorder, (arrays, count), cameras);
            let pass = if color { &mut self.color } else { &mut self.language };
            pass.backward(&mut recorder, self.lister.ranks(), (&arrays.means, head));
            recorder.submit();
            let hits: Vec<HitCount> = pass.hit_count().read(&gpu, 1)?;
            if !pass.outgrown(hits[0]) {
                return self.read_gradients((count, head.features.rows), color);
            }
        }
    }

    /// Reads gradients back and puts them from the order of ranks into that of the map.
    fn read_gradients(
        &self,
        (count, rows): (usize, usize),
        color: bool,
    ) -> Result<HeadGradient, GpuError> {
        let gpu = &self.gpu;
        let (pass, ranks) = (if color { &self.color } else { &self.language }, self.lister.ranks());
        let gradients = &pass.training().gradients;
        let visible = ranks.visible.read(gpu, 1)?[0].count as usize;
        let gaussians = ranks.gaussian_from_visible.read(gpu, visible)?;
        let place = |from: &[Row], rows: usize, used: usize| {
            let mut to = vec![[0.0; 4]; used * count];
            for (gaussian, from) in gaussians.iter().zip(from.chunks(rows)) {
                to[*gaussian as usize * used..][..used].copy_from_slice(&from[..used]);
            }
            to
        };
        let geometry = place(&gradients.geometry.read(gpu, 2 * visible)?, 2, 2);
        let features = place(&gradients.features.read(gpu, rows * visible)?, rows, rows);
        let moves = gradients.moves.read(gpu, if color { MOVE_ROWS * visible } else { 0 })?;
        let means = place(&moves, MOVE_ROWS, usize::from(color));
        let mut pose = [0.0; 6];
        for rows in moves.chunks(MOVE_ROWS) {
            (0..6).for_each(|i| pose[i] += rows[1 + i / 3][i % 3]);
        }
        let channels = if color { 3 } else { self.channels };
        Ok(HeadGradient {
            means: means.iter().map(|m| [m[0], m[1], m[2]]).collect(),
            head: HostHead::from_rows(&geometry, unpad_rows(&features, channels), channels),
            pose,
        })
    }
}
