//! A picture made smaller by a whole factor.
//!
//! Color is the mean of each block of pixels. Depth is the mean of the block's nearest surface.

use crate::picture::Picture;

/// Depths within this share of the nearest depth of a block belong to the same surface. The mean over
/// several surfaces would be a point between them.
const SAME_SURFACE: f32 = 0.02;

/// The picture made smaller by `factor`: its width and height, `[height * width * 3]` of color and
/// `[height * width]` of depth. Rows and columns at the border that do not fill a whole block are left out;
/// one row or column is left at least.
pub fn smaller(picture: &Picture<'_>, factor: usize) -> ([usize; 2], Vec<u8>, Vec<f32>) {
    let Picture { width: stride, rgb: full, depth_metres: depths, .. } = *picture;
    let columns = factor.min(picture.width);
    let rows = factor.min(picture.height);
    let (width, height) = ((picture.width / factor).max(1), (picture.height / factor).max(1));
    let pixels = (columns * rows) as u32;
    let mut rgb = Vec::with_capacity(width * height * 3);
    let mut depth_metres = Vec::with_capacity(width * height);
    for row in 0..height {
        for column in 0..width {
            let mut sum = [0u32; 3];
            let mut nearest = f32::INFINITY;
            for y in row * factor..row * factor + rows {
                let first = y * stride + column * factor;
                for color in full[3 * first..3 * (first + columns)].chunks_exact(3) {
                    for (sum, value) in sum.iter_mut().zip(color) {
                        *sum += u32::from(*value);
                    }
                }
                for depth in &depths[first..first + columns] {
                    nearest = if *depth > 0.0 { nearest.min(*depth) } else { nearest };
                }
            }
            rgb.extend(sum.map(|sum| ((sum + pixels / 2) / pixels) as u8));
            let (mut total, mut count) = (0.0, 0u32);
            for y in row * factor..row * factor + rows {
                let first = y * stride + column * factor;
                for depth in &depths[first..first + columns] {
                    if *depth > 0.0 && *depth <= nearest * (1.0 + SAME_SURFACE) {
                        total += depth;
                        count += 1;
                    }
                }
            }
            depth_metres.push(if count > 0 { total / count as f32 } else { 0.0 });
        }
    }
    ([width, height], rgb, depth_metres)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_the_mean_of_the_nearest_surface() {
        let depth = |depths: &[f32]| {
            let rgb = vec![0; 3 * depths.len()];
            let picture = Picture {
                width: depths.len(),
                height: 1,
                focal: [1.0; 2],
                centre: [0.0; 2],
                rgb: &rgb,
                depth_metres: depths,
            };
            smaller(&picture, depths.len()).2[0]
        };
        assert!((depth(&[2.0, 2.02, 0.0, 2.5]) - 2.01).abs() < 1e-6, "what lies on one surface");
        assert_eq!(depth(&[0.0; 4]), 0.0, "nothing was measured");
        assert!((depth(&[2.0, 2.1]) - 2.05).abs() > 0.04, "two surfaces have no mean");
    }

    #[test]
    fn what_does_not_fill_a_block_is_left_out() {
        let rgb: Vec<u8> = (0..7 * 3).flat_map(|at| [at; 3]).collect();
        let depths = vec![1.0; 21];
        let picture = Picture {
            width: 7,
            height: 3,
            focal: [1.0; 2],
            centre: [0.0; 2],
            rgb: &rgb,
            depth_metres: &depths,
        };
        let ([width, height], color, depth) = smaller(&picture, 2);
        assert_eq!((width, height, depth.len()), (3, 1, 3));
        assert_eq!(color[..3], [4; 3], "0, 1, 7 and 8: the mean, rounded");
        assert_eq!(smaller(&picture, 7).0, [1, 1], "all rows make the one row that is left");
    }
}
