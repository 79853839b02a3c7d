//! Prepares an image for a network: size, channel order and normalisation of the bundle's manifest.
//!
//! In: `[height * width * 3]` RGB, 8 bit. Out: planes `[3, height, width]`.

use super::resample::Resampler;
use crate::pipeline::frame::Frame;
use crate::pipeline::network::{ChannelOrder, Fit, ImageSpec};

/// Prepares images, reusing its buffers.
#[derive(Default)]
pub(super) struct Preparation {
    resampler: Resampler,
}

impl Preparation {
    /// Resamples, reorders and normalises the image into `planes` `[3, height, width]`. Returns the
    /// share of columns and of rows that the image fills, from the top left.
    pub(super) fn run(&mut self, frame: &Frame, spec: &ImageSpec, planes: &mut [f32]) -> [f32; 2] {
        let from = (frame.intrinsics.width as usize, frame.intrinsics.height as usize);
        let (width, height) = fitted(from, spec);
        let pixels = self.resampler.run(&frame.rgb, from, (width, height), spec.antialias);
        // Padding has the mean color, which is zero after normalisation.
        planes.fill(0.0);
        for (channel, plane) in planes.chunks_exact_mut(spec.height * spec.width).enumerate() {
            let source_channel = match spec.channel_order {
                ChannelOrder::Rgb => channel,
                ChannelOrder::Bgr => 2 - channel,
            };
            let (mean, scale) = (spec.mean[channel], 1.0 / spec.std[channel]);
            let rows = plane.chunks_exact_mut(spec.width).zip(pixels.chunks_exact(3 * width));
            for (row, pixels) in rows {
                for (value, pixel) in row.iter_mut().zip(pixels.chunks_exact(3)) {
                    *value = (pixel[source_channel] - mean) * scale;
                }
            }
        }
        covered(from, spec)
    }
}

/// The share of the network's columns and rows that an image of this (width, height) fills.
fn covered(from: (usize, usize), spec: &ImageSpec) -> [f32; 2] {
    let (width, height) = fitted(from, spec);
    [width as f32 / spec.width as f32, height as f32 / spec.height as f32]
}

/// Width and height of the image within the network's input.
fn fitted((width, height): (usize, usize), spec: &ImageSpec) -> (usize, usize) {
    match spec.fit {
        Fit::Squash => (spec.width, spec.height),
        Fit::Pad => {
            let scale = (spec.width as f64 / width as f64).min(spec.height as f64 / height as f64);
            let side = |from: usize, limit: usize| {
                ((from as f64 * scale).round() as usize).clamp(1, limit)
            };
            (side(width, spec.width), side(height, spec.height))
        }
    }
}
