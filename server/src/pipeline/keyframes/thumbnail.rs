//! Grey thumbnails that tell which keyframes look like a frame, as in the relocaliser of PTAM (Klein and
//! Murray 2008).

use super::super::downsampled_frame::DownsampledFrame;
use super::super::saving::packed;
use serde::{Deserialize, Serialize};

const COLUMNS: usize = 40;
const ROWS: usize = 30;
/// Number of 3x3 box filters; three are close to a Gaussian of 1.4 pixels.
const BLURS: usize = 3;

/// A blurred grey image of 40x30 pixels with mean 0 and norm 1; all zeros if the image has no contrast.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(in super::super) struct Thumbnail(#[serde(with = "packed")] Vec<f32>);

impl Thumbnail {
    /// Reduces a frame to its thumbnail.
    pub fn new(frame: &DownsampledFrame) -> Self {
        let (width, height) = (frame.camera.width as usize, frame.camera.height as usize);
        let mut grey = vec![0.0; COLUMNS * ROWS];
        for (at, grey) in grey.iter_mut().enumerate() {
            let part = |index: usize, parts: usize, size: usize| {
                let first = (index * size / parts).min(size.saturating_sub(1));
                first..((index + 1) * size / parts).max(first + 1)
            };
            let columns = part(at % COLUMNS, COLUMNS, width);
            let (mut sum, mut count) = (0u32, 0u32);
            for y in part(at / COLUMNS, ROWS, height) {
                for x in columns.clone() {
                    let rgb = &frame.rgb[3 * (y * width + x)..][..3];
                    sum += rgb.iter().map(|value| u32::from(*value)).sum::<u32>();
                    count += 3;
                }
            }
            *grey = sum as f32 / count.max(1) as f32;
        }
        for _ in 0..BLURS {
            grey = blurred(&grey);
        }
        let mean = grey.iter().sum::<f32>() / grey.len() as f32;
        grey.iter_mut().for_each(|value| *value -= mean);
        let length = grey.iter().map(|value| value * value).sum::<f32>().sqrt();
        // Below one grey level on average there is only noise.
        let scale = if length > (grey.len() as f32).sqrt() { 1.0 / length } else { 0.0 };
        grey.iter_mut().for_each(|value| *value *= scale);
        Self(grey)
    }

    /// Normalised cross-correlation, -1 to 1.
    pub fn similarity(&self, other: &Self) -> f32 {
        self.0.iter().zip(&other.0).map(|(a, b)| a * b).sum()
    }
}

/// A 3x3 box filter; at the border over the neighbours that exist.
fn blurred(grey: &[f32]) -> Vec<f32> {
    (0..grey.len())
        .map(|at| {
            let (x, y) = (at % COLUMNS, at / COLUMNS);
            let (mut sum, mut count) = (0.0, 0.0);
            for y in y.saturating_sub(1)..(y + 2).min(ROWS) {
                for x in x.saturating_sub(1)..(x + 2).min(COLUMNS) {
                    sum += grey[y * COLUMNS + x];
                    count += 1.0;
                }
            }
            sum / count
        })
        .collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use lexsplat_gpu::Camera;
    use nalgebra::Isometry3;

    /// Vertical stripes `stripe` pixels wide, shifted by `shift` pixels, their brightness scaled by `gain`.
    pub fn stripes(stripe: usize, shift: usize, gain: f32) -> DownsampledFrame {
        let (width, height) = (160, 120);
        let camera = Camera {
            width: width as u32,
            height: height as u32,
            fx: 100.0,
            fy: 100.0,
            cx: 79.5,
            cy: 59.5,
            camera_from_world: Isometry3::identity(),
        };
        let grey = |at: usize| {
            let is_light = ((at % width + shift) / stripe).is_multiple_of(2);
            (gain * if is_light { 120.0 } else { 40.0 }) as u8
        };
        let rgb = (0..width * height).flat_map(|at| [grey(at); 3]).collect();
        DownsampledFrame { camera, rgb, depth_metres: vec![1.0; width * height].into() }
    }

    #[test]
    fn an_image_without_contrast_resembles_nothing() {
        let grey = Thumbnail::new(&stripes(1000, 0, 1.0));
        assert_eq!(grey.similarity(&grey), 0.0);
        let stripes = Thumbnail::new(&stripes(25, 0, 1.0));
        assert!((stripes.similarity(&stripes) - 1.0).abs() < 1e-5);
    }
}
