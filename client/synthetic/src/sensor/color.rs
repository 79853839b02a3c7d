//! What a color camera makes of the clean picture: rolling shutter and blur by the camera's motion,
//! vignetting, exposure, shot and read noise, clipping. In: linear light. Out: sRGB bytes.
//!
//! The exposure is centred on the frame's pose: half of the blur comes from before it, and the
//! middle row is read at it. So the true pose stays the right one.

use super::clean::{Clean, srgb_byte};
use super::motion::Flow;
use super::noise::{Noise, Purpose};
use super::preset::ColorPreset;
use rayon::prelude::*;

/// Most samples of a moving exposure.
const MOST_SAMPLES: usize = 16;

/// The picture as the camera sends it, sRGB, 3 bytes per pixel.
pub(super) fn seen(
    clean: &Clean,
    flow: &Flow,
    preset: &ColorPreset,
    gain: f32,
    noise: Noise,
) -> Vec<u8> {
    let (width, height) = (clean.width(), clean.height());
    let noises = noise.normal(Purpose::Light, 3 * width * height);
    let way = flow.fastest() * preset.exposure as f32;
    let samples = (way.ceil() as usize).clamp(1, MOST_SAMPLES);
    let mut bytes = vec![0; 3 * width * height];
    bytes.par_chunks_exact_mut(3 * width).enumerate().for_each(|(y, row)| {
        let read_at = preset.readout * ((y as f64 + 0.5) / height as f64 - 0.5);
        for (x, bytes) in row.chunks_exact_mut(3).enumerate() {
            let mut light = [0.0; 3];
            for sample in 0..samples {
                let part = (sample as f64 + 0.5) / samples as f64 - 0.5;
                let at = flow.source(x, y, (read_at + part * preset.exposure) as f32);
                let here = interpolated(clean, at);
                (0..3).for_each(|c| light[c] += here[c] / samples as f32);
            }
            let level = gain * (1.0 - preset.vignetting * corner(x, y, width, height));
            for (c, byte) in bytes.iter_mut().enumerate() {
                let value = light[c] * level;
                // Fewer photons make the same value at a higher gain.
                let shot = value * gain.max(1.0) / preset.white_electrons;
                let deviation = (shot + preset.read * preset.read).sqrt();
                *byte = srgb_byte(value + deviation * noises[3 * (y * width + x) + c]);
            }
        }
    });
    bytes
}

/// Square of the distance from the middle; 1 in the corners.
fn corner(x: usize, y: usize, width: usize, height: usize) -> f32 {
    let from_middle = |at: usize, size: usize| (2 * at + 1) as f32 / size as f32 - 1.0;
    (from_middle(x, width).powi(2) + from_middle(y, height).powi(2)) / 2.0
}

fn interpolated(clean: &Clean, [x, y]: [f32; 2]) -> [f32; 3] {
    let (width, height) = (clean.width(), clean.height());
    let x = x.clamp(0.0, (width - 1) as f32);
    let y = y.clamp(0.0, (height - 1) as f32);
    let (left, top) = (x as usize, y as usize);
    let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let (tx, ty) = (x - left as f32, y - top as f32);
    let light = |row: usize, column: usize| &clean.light[row * width + column];
    std::array::from_fn(|c| {
        let above = light(top, left)[c] * (1.0 - tx) + light(top, right)[c] * tx;
        let below = light(bottom, left)[c] * (1.0 - tx) + light(bottom, right)[c] * tx;
        above * (1.0 - ty) + below * ty
    })
}
