//! Errors of rendered images: PSNR (decibels) and SSIM (0..1) of 8-bit RGB images scaled to 0..1,
//! and the mean depth error (metres).
//!
//! PSNR = -10 log10 of the mean square over all pixels and channels. SSIM: Z. Wang et al., "Image
//! quality assessment" (2004), Gaussian window of 11x11 with sigma 1.5, K1 = 0.01, K2 = 0.03, mean
//! over channels and over the pixels with a full window. The released code of the paper pads with
//! zeros and counts every pixel instead.

use image::RgbImage;

const WINDOW: usize = 11;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Error of rendered depth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthError {
    /// Mean absolute error over pixels that are measured and rendered, metres.
    pub l1_metres: f64,
    /// Share of the measured pixels that the map renders.
    pub rendered_share: f64,
}

/// Peak signal-to-noise ratio, decibels; infinite for equal images.
///
/// # Panics
/// If the images differ in size.
pub fn psnr_db(truth: &RgbImage, found: &RgbImage) -> f64 {
    assert_eq!(truth.dimensions(), found.dimensions(), "pictures of one size");
    let square = |(a, b): (&u8, &u8)| {
        let difference = (f64::from(*a) - f64::from(*b)) / 255.0;
        difference * difference
    };
    let sum: f64 = truth.as_raw().iter().zip(found.as_raw()).map(square).sum();
    -10.0 * (sum / truth.as_raw().len() as f64).log10()
}

/// Structural similarity; 1 for equal images.
///
/// # Panics
/// If the images differ in size or are smaller than the window.
pub fn ssim(truth: &RgbImage, found: &RgbImage) -> f64 {
    assert_eq!(truth.dimensions(), found.dimensions(), "pictures of one size");
    let (width, height) = (truth.width() as usize, truth.height() as usize);
    assert!(width >= WINDOW && height >= WINDOW, "pictures of at least {WINDOW}x{WINDOW} pixels");
    let channel = |picture: &RgbImage, at: usize| -> Vec<f64> {
        picture.as_raw().iter().skip(at).step_by(3).map(|v| f64::from(*v) / 255.0).collect()
    };
    let of_channel = |at: usize| {
        let (a, b) = (channel(truth, at), channel(found, at));
        let product = |x: &[f64], y: &[f64]| -> Vec<f64> {
            blurred(&x.iter().zip(y).map(|(x, y)| x * y).collect::<Vec<_>>(), width)
        };
        let (aa, bb, ab) = (product(&a, &a), product(&b, &b), product(&a, &b));
        let (mean_a, mean_b) = (blurred(&a, width), blurred(&b, width));
        let similarity = |i: usize| {
            let (a, b) = (mean_a[i], mean_b[i]);
            let (var_a, var_b, cov) = (aa[i] - a * a, bb[i] - b * b, ab[i] - a * b);
            (2.0 * a * b + C1) * (2.0 * cov + C2) / ((a * a + b * b + C1) * (var_a + var_b + C2))
        };
        (0..mean_a.len()).map(similarity).sum::<f64>() / mean_a.len() as f64
    };
    (0..3).map(of_channel).sum::<f64>() / 3.0
}

/// Gaussian mean of the pixels with a full window.
fn blurred(values: &[f64], width: usize) -> Vec<f64> {
    let kernel = kernel();
    let out_width = width - WINDOW + 1;
    let rows: Vec<f64> = values
        .chunks_exact(width)
        .flat_map(|row| row.windows(WINDOW))
        .map(|window| window.iter().zip(&kernel).map(|(v, k)| v * k).sum())
        .collect();
    let out_height = values.len() / width - WINDOW + 1;
    let mut out = vec![0.0; out_width * out_height];
    for (y, out) in out.chunks_exact_mut(out_width).enumerate() {
        for (k, weight) in kernel.iter().enumerate() {
            let row = &rows[(y + k) * out_width..][..out_width];
            out.iter_mut().zip(row).for_each(|(out, v)| *out += weight * v);
        }
    }
    out
}

fn kernel() -> [f64; WINDOW] {
    let weight = |i: usize| {
        let offset = i as f64 - (WINDOW / 2) as f64;
        (-offset * offset / (2.0 * SIGMA * SIGMA)).exp()
    };
    let weights: [f64; WINDOW] = std::array::from_fn(weight);
    let sum: f64 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}

/// The error over the pixels that are measured and rendered; `None` if there are none. 0 and NaN
/// are no depth.
///
/// # Panics
/// If the lengths differ.
pub fn depth_error(measured: &[f32], rendered: &[f32]) -> Option<DepthError> {
    assert_eq!(measured.len(), rendered.len(), "depths of one size");
    let is_depth = |metres: f32| metres > 0.0 && metres.is_finite();
    let known = measured.iter().zip(rendered).filter(|(measured, _)| is_depth(**measured));
    let (mut of, mut count, mut sum) = (0_usize, 0_usize, 0.0);
    for (&measured, &rendered) in known {
        of += 1;
        if is_depth(rendered) {
            count += 1;
            sum += f64::from((measured - rendered).abs());
        }
    }
    (count > 0).then(|| DepthError {
        l1_metres: sum / count as f64,
        rendered_share: count as f64 / of as f64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture with structure, and the same with noise.
    fn pictures() -> (RgbImage, RgbImage) {
        let truth = |x: u32, y: u32, c: u32| (x * 7 + y * 13 + c * 50 + x * y) % 256;
        let noisy = |x: u32, y: u32, c: u32| {
            let noise = ((x * 31 + y * 17 + c * 5) % 23) as i32 - 11;
            (truth(x, y, c) as i32 + noise).clamp(0, 255) as u32
        };
        let picture = |value: &dyn Fn(u32, u32, u32) -> u32| {
            RgbImage::from_fn(24, 16, |x, y| image::Rgb([0, 1, 2].map(|c| value(x, y, c) as u8)))
        };
        (picture(&truth), picture(&noisy))
    }

    #[test]
    fn numbers_are_those_of_scikit_image() {
        // peak_signal_noise_ratio(a, b, data_range=1.0) and structural_similarity(a, b,
        // gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1.0,
        // channel_axis=2) of scikit-image on these formulas divided by 255.
        let (truth, noisy) = pictures();
        assert!((psnr_db(&truth, &noisy) - 31.794_015_422_510_78).abs() < 1e-9);
        assert!((ssim(&truth, &noisy) - 0.993_279_913_902_218_6).abs() < 1e-9);
    }

    #[test]
    fn equal_pictures_are_equal_and_a_shift_is_seen() {
        let (truth, _) = pictures();
        assert_eq!(psnr_db(&truth, &truth), f64::INFINITY);
        assert!((ssim(&truth, &truth) - 1.0).abs() < 1e-12);
        let shifted = RgbImage::from_fn(24, 16, |x, y| *truth.get_pixel((x + 1) % 24, y));
        assert!(psnr_db(&truth, &shifted) < 15.0 && ssim(&truth, &shifted) < 0.8);
        // By hand: all pixels off by 51/255 = 0.2, so -10 log10 0.04.
        let flat = |level: u8| RgbImage::from_pixel(12, 12, image::Rgb([level; 3]));
        assert!((psnr_db(&flat(100), &flat(151)) - 13.979_400_086_720_376).abs() < 1e-9);
        // Flat pictures differ in luminance only: (2ab + C1) / (a² + b² + C1).
        let (a, b) = (100.0 / 255.0, 151.0 / 255.0);
        let by_hand = (2.0 * a * b + C1) / (a * a + b * b + C1);
        assert!((ssim(&flat(100), &flat(151)) - by_hand).abs() < 1e-9);
    }

    #[test]
    fn depth_error_is_over_pixels_that_both_have() {
        let measured = [1.0, 2.0, 0.0, 4.0, f32::NAN];
        let found = depth_error(&measured, &[1.5, 1.75, 9.0, 0.0, 3.0]).unwrap();
        assert_eq!(found, DepthError { l1_metres: 0.375, rendered_share: 2.0 / 3.0 });
        assert_eq!(depth_error(&measured, &[0.0; 5]), None);
    }
}
