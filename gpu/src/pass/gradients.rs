//! Gradients of any function of an image, read back to the host. Tests prove the backward pass with
//! them, and a caller can use them for a loss of its own. Training does not go through here.

use crate::device::{GpuError, expect_len};
use crate::map::rows::{pad_rows, unpad_rows};
use crate::map::{Gaussians, HeadKind, HostHead};
use crate::pass::camera::Camera;
use crate::pass::project::MOVE_ROWS;
use crate::pass::render::{HeadCameras, Renderer};
use crate::shader::Recorder;
use crate::shader::layout::{HitCount, Row};

/// dL/dparameters of one head, in the order of the map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeadGradient {
    /// dL/dmean, per metre; empty for language, which does not move means.
    pub means: Vec<[f32; 3]>,
    /// dL/d(rotation, log scale, opacity logit, feature).
    pub head: HostHead,
    /// dL/dtau with tau = (rho, theta), a left perturbation of `camera_from_world`; zero for
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
        self.gradients(gaussians, camera, d_image, HeadKind::Color)
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
        let d_image = pad_rows(d_codes, self.channels);
        self.gradients(gaussians, camera, &d_image, HeadKind::Language)
    }

    fn gradients(
        &mut self,
        gaussians: &Gaussians,
        camera: &Camera,
        d_image: &[Row],
        head: HeadKind,
    ) -> Result<HeadGradient, GpuError> {
        camera.check()?;
        let Some(map) = gaussians.slice() else { return Ok(HeadGradient::default()) };
        let cameras = HeadCameras::only(head, camera);
        let gpu = self.gpu.clone();
        loop {
            self.reserve(gaussians, cameras, true)?;
            self.head(head).backward_buffers().image_gradients.write(&gpu, 0, d_image);
            let mut recorder = Recorder::new(&gpu)?;
            self.record_forward(&mut recorder, map, cameras);
            self.head(head).backward(&mut recorder, self.binning(), map.arrays);
            recorder.submit();
            let pass = self.head_mut(head);
            let hits: Vec<HitCount> = pass.hit_count().read(&gpu, 1)?;
            if !pass.grow_after(hits[0]) {
                return self.read_gradients(map.count, head);
            }
        }
    }

    /// Reads gradients back and puts them from the order of the view into that of the map.
    fn read_gradients(&self, count: usize, head: HeadKind) -> Result<HeadGradient, GpuError> {
        let (gpu, ranks) = (&self.gpu, self.binning().ranks());
        let color = head == HeadKind::Color;
        let rows = head.rows(self.channels);
        let gradients = &self.head(head).backward_buffers().gradients;
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
