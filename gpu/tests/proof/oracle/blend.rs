//! Reference, not for production: every pixel walks over every splat, in depth order, in f64. No
//! tiles, so that the tile test is part of what is compared.

use nalgebra::{Matrix2, Vector2};

use crate::oracle::project::Splat;
use lexsplat_gpu::shader::layout::{MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE};

/// A blended picture.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Sum of weight times feature; height x width x channels.
    pub image: Vec<f64>,
    /// Light that passes; height x width.
    pub transmittance: Vec<f64>,
    /// Sum over pixels of each splat's weight.
    pub weights: Vec<f64>,
    /// Pixels that each splat reaches with more than half of the light left behind it.
    pub touched: Vec<f32>,
}

/// Gradients of all splats.
pub struct Gradients {
    /// Of the splats; depth is left at zero.
    pub splats: Vec<Splat>,
    /// Of the features, `channels` per splat.
    pub features: Vec<f64>,
}

/// One splat at one pixel.
struct Touch {
    splat: usize,
    offset: Vector2<f64>,
    gauss: f64,
    alpha: f64,
    /// Light that reaches the splat.
    transmittance: f64,
}

/// The splats that a pixel blends, front to back, and the light that passes them all.
fn touches(splats: &[Option<Splat>], order: &[usize], pixel: [usize; 2]) -> (Vec<Touch>, f64) {
    let at = Vector2::new(pixel[0] as f64, pixel[1] as f64);
    let mut found = Vec::new();
    let mut transmittance = 1.0;
    for (index, splat) in order.iter().filter_map(|i| Some((*i, splats[*i].as_ref()?))) {
        let offset = splat.mean - at;
        let power = -0.5 * offset.dot(&(splat.conic * offset));
        let gauss = power.exp();
        let alpha = f64::min(f64::from(MAX_ALPHA), splat.opacity * gauss);
        if power > 0.0 || alpha < f64::from(MIN_ALPHA) {
            continue;
        }
        if transmittance * (1.0 - alpha) < f64::from(MIN_TRANSMITTANCE) {
            break;
        }
        found.push(Touch { splat: index, offset, gauss, alpha, transmittance });
        transmittance *= 1.0 - alpha;
    }
    (found, transmittance)
}

/// Visible splats by depth; equal depths keep their order.
pub fn depth_order(splats: &[Option<Splat>]) -> Vec<usize> {
    let depth = |i: &usize| splats[*i].as_ref().map_or(f64::INFINITY, |splat| splat.depth);
    let mut order: Vec<usize> = (0..splats.len()).collect();
    order.sort_by(|a, b| depth(a).total_cmp(&depth(b)));
    order
}

/// Blends `features` (`channels` per splat) into a picture of `size` columns and rows.
pub fn forward(
    splats: &[Option<Splat>],
    features: &[f64],
    channels: usize,
    size: [usize; 2],
) -> Picture {
    let order = depth_order(splats);
    let pixels = size[0] * size[1];
    let mut picture = Picture {
        image: vec![0.0; pixels * channels],
        transmittance: vec![1.0; pixels],
        weights: vec![0.0; splats.len()],
        touched: vec![0.0; splats.len()],
    };
    for pixel in 0..pixels {
        let (found, rest) = touches(splats, &order, [pixel % size[0], pixel / size[0]]);
        picture.transmittance[pixel] = rest;
        for touch in found {
            let weight = touch.alpha * touch.transmittance;
            picture.weights[touch.splat] += weight;
            if touch.transmittance - weight > 0.5 {
                picture.touched[touch.splat] += 1.0;
            }
            for channel in 0..channels {
                picture.image[pixel * channels + channel] +=
                    weight * features[touch.splat * channels + channel];
            }
        }
    }
    picture
}

/// Gradients from dL/dimage (height x width x channels).
pub fn backward(
    splats: &[Option<Splat>],
    features: &[f64],
    d_image: &[f64],
    (channels, size): (usize, [usize; 2]),
) -> Gradients {
    let order = depth_order(splats);
    let none = Splat { mean: Vector2::zeros(), conic: Matrix2::zeros(), opacity: 0.0, depth: 0.0 };
    let mut gradients =
        Gradients { splats: vec![none; splats.len()], features: vec![0.0; features.len()] };
    for (pixel, g) in d_image.chunks(channels).enumerate() {
        let (found, _) = touches(splats, &order, [pixel % size[0], pixel / size[0]]);
        let mut behind = 0.0; // (light from behind) . g
        for touch in found.iter().rev() {
            let splat = splats[touch.splat].as_ref().expect("a touched splat is visible");
            let feature = &features[touch.splat * channels..][..channels];
            let d_feature = &mut gradients.features[touch.splat * channels..][..channels];
            let mut lit = 0.0; // feature . g
            for channel in 0..channels {
                d_feature[channel] += touch.alpha * touch.transmittance * g[channel];
                lit += feature[channel] * g[channel];
            }
            let d_alpha = touch.transmittance * (lit - behind);
            behind = touch.alpha * lit + (1.0 - touch.alpha) * behind;
            if touch.alpha < f64::from(MAX_ALPHA) {
                let out = &mut gradients.splats[touch.splat];
                let d_power = touch.alpha * d_alpha;
                out.opacity += touch.gauss * d_alpha;
                out.mean -= d_power * (splat.conic * touch.offset);
                out.conic -= 0.5 * d_power * touch.offset * touch.offset.transpose();
            }
        }
    }
    gradients
}
