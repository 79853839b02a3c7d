//! Reference, not for production: the whole pass of one head in f64, from parameters to picture and
//! from a picture's gradient to the parameters'.

pub mod adam;
pub mod align;
pub mod blend;
pub mod loss;
pub mod morton;
pub mod project;
pub mod prune;
pub mod pyramid;
pub mod scan;
pub mod sort;

use nalgebra::{Vector3, Vector4, Vector6};

use crate::oracle::project::{Shape, Splat, View};
use lexsplat_gpu::{HostGaussians, HostHead};

/// One head of a map in f64.
#[derive(Clone, Debug)]
pub struct Head {
    /// Geometry of each Gaussian.
    pub shapes: Vec<Shape>,
    /// Features, `channels` per Gaussian.
    pub features: Vec<f64>,
    /// Length of a feature.
    pub channels: usize,
    /// Whether depth is blended as one more channel, as for color.
    pub depth: bool,
}

impl Head {
    /// The color head: rgb and, as fourth channel of the picture, depth.
    pub fn color(gaussians: &HostGaussians) -> Self {
        Self::new(gaussians, &gaussians.color, true)
    }

    /// The language head.
    pub fn language(gaussians: &HostGaussians) -> Self {
        Self::new(gaussians, &gaussians.language, false)
    }

    fn new(gaussians: &HostGaussians, head: &HostHead, depth: bool) -> Self {
        let shape = |i: usize| Shape {
            mean: Vector3::from(gaussians.means[i]).cast(),
            rotation: Vector4::from(head.rotations[i]).cast(),
            log_scale: Vector3::from(head.log_scales[i]).cast(),
            opacity_logit: f64::from(head.opacity_logits[i]),
        };
        Self {
            shapes: (0..gaussians.len()).map(shape).collect(),
            features: head.features.iter().map(|value| f64::from(*value)).collect(),
            channels: head.channels,
            depth,
        }
    }

    /// Channels of the picture.
    pub fn picture_channels(&self) -> usize {
        self.channels + usize::from(self.depth)
    }

    fn project(&self, view: &View) -> (Vec<Option<Splat>>, Vec<f64>) {
        let splats: Vec<_> = self.shapes.iter().map(|s| project::forward(view, s)).collect();
        let mut features = Vec::new();
        for (splat, feature) in splats.iter().zip(self.features.chunks(self.channels)) {
            features.extend_from_slice(feature);
            if self.depth {
                features.push(splat.as_ref().map_or(0.0, |splat| splat.depth));
            }
        }
        (splats, features)
    }

    /// Renders a view.
    pub fn render(&self, view: &View) -> blend::Picture {
        let (splats, features) = self.project(view);
        blend::forward(&splats, &features, self.picture_channels(), view.size)
    }

    /// dL/dparameters from dL/dpicture (height x width x picture channels). For language the
    /// gradient of the mean is computed as well, though training does not use it.
    pub fn gradients(&self, view: &View, d_image: &[f64]) -> Head {
        let (splats, features) = self.project(view);
        let channels = self.picture_channels();
        let mut found = blend::backward(&splats, &features, d_image, (channels, view.size));
        let mut gradient = self.clone();
        for (i, shape) in self.shapes.iter().enumerate() {
            let d_feature = &found.features[i * channels..][..channels];
            gradient.features[i * self.channels..][..self.channels]
                .copy_from_slice(&d_feature[..self.channels]);
            if self.depth {
                found.splats[i].depth = d_feature[self.channels];
            }
            gradient.shapes[i] = if splats[i].is_some() {
                project::backward(view, shape, &found.splats[i])
            } else {
                Shape {
                    mean: Vector3::zeros(),
                    rotation: Vector4::zeros(),
                    log_scale: Vector3::zeros(),
                    opacity_logit: 0.0,
                }
            };
        }
        gradient
    }

    /// dL/d(rho, theta) from dL/dpicture, a left perturbation of `camera_from_world`.
    pub fn pose_gradient(&self, view: &View, d_image: &[f64]) -> Vector6<f64> {
        let (splats, features) = self.project(view);
        let channels = self.picture_channels();
        let mut found = blend::backward(&splats, &features, d_image, (channels, view.size));
        let mut pose = Vector6::zeros();
        for (i, shape) in self.shapes.iter().enumerate().filter(|(i, _)| splats[*i].is_some()) {
            if self.depth {
                found.splats[i].depth = found.features[i * channels + self.channels];
            }
            pose += project::pose_backward(view, shape, &found.splats[i]);
        }
        pose
    }

    /// All parameters in a row, Gaussian by Gaussian: mean 3, rotation 4, log scale 3, opacity
    /// logit 1, feature.
    pub fn flatten(&self) -> Vec<f64> {
        let mut flat = Vec::new();
        for (shape, feature) in self.shapes.iter().zip(self.features.chunks(self.channels)) {
            flat.extend(shape.mean.iter().chain(&shape.rotation).chain(&shape.log_scale));
            flat.push(shape.opacity_logit);
            flat.extend(feature);
        }
        flat
    }

    /// Undoes [`Head::flatten`].
    pub fn with_flat(&self, flat: &[f64]) -> Self {
        let mut head = self.clone();
        for (i, values) in flat.chunks(11 + self.channels).enumerate() {
            head.shapes[i] = Shape {
                mean: Vector3::from_column_slice(&values[..3]),
                rotation: Vector4::from_column_slice(&values[3..7]),
                log_scale: Vector3::from_column_slice(&values[7..10]),
                opacity_logit: values[10],
            };
            head.features[i * self.channels..][..self.channels].copy_from_slice(&values[11..]);
        }
        head
    }
}
