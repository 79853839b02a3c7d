//! Gradients of any function of a picture, read back: how the backward pass is proven, and a tool
//! for whoever has a loss of their own. Training does not come by here.

use crate::camera::Camera;
use crate::error::{GpuError, expect_len};
use crate::gaussians::{Gaussians, HostHead};
use crate::kernel::Recorder;
use crate::layout::{HitCount, Row};
use crate::pass::Pass;
use crate::render::{Renderer, check_camera};
use crate::target::pad_rows;

/// dL/dparameters of one head.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeadGradient {
    /// dL/dmean, per metre; empty for language, which does not move means.
    pub means: Vec<[f32; 3]>,
    /// dL/d(rotation, log scale, opacity logit, feature).
    pub head: HostHead,
}

impl Renderer {
    /// Takes dL/d(r, g, b, depth) of each pixel (height x width) to the colour head and the means.
    ///
    /// # Errors
    /// [`GpuError::ShapeMismatch`] and as [`Renderer::render_colour`].
    pub fn colour_gradients(
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
    /// As [`Renderer::colour_gradients`].
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
        colour: bool,
    ) -> Result<HeadGradient, GpuError> {
        check_camera(camera)?;
        let count = gaussians.len();
        let channels = if colour { 3 } else { self.channels };
        let Some(arrays) = gaussians.arrays().filter(|_| count > 0) else {
            return Ok(HeadGradient::default());
        };
        let head = if colour { &arrays.colour } else { &arrays.language };
        let (gpu, lister) = (&self.gpu, &self.lister);
        let pass: &mut Pass = if colour { &mut self.colour } else { &mut self.language };
        loop {
            pass.reserve(gpu, lister, (gaussians, camera), true)?;
            pass.training().image_gradients.write(gpu, 0, d_image);
            let mut recorder = Recorder::new(gpu)?;
            pass.forward(gpu, &mut recorder, lister, (&arrays.means, head, count), camera);
            pass.backward(&mut recorder, &arrays.means, head);
            recorder.submit();
            let hits: Vec<HitCount> = pass.hit_count().read(gpu, 1)?;
            if pass.outgrown(hits[0]) {
                continue;
            }
            let training = pass.training();
            let geometry = training.gradients.geometry.read(gpu, 2 * count)?;
            let features = training.gradients.features.read(gpu, head.features.rows * count)?;
            let means = training.mean_gradients.read(gpu, if colour { count } else { 0 })?;
            return Ok(HeadGradient {
                means: means.iter().map(|m| [m[0], m[1], m[2]]).collect(),
                head: HostHead::from_rows(&geometry, &features, channels),
            });
        }
    }
}
