//! PNG files: color, depth in millimetres, and heat maps in color.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};

/// Points of the heat maps' colors from 0 to 1: dark blue, blue, green, yellow, red. Lightness rises
/// up to yellow, so that it reads in grey, too.
const HEAT: [[f32; 3]; 6] = [
    [24.0, 15.0, 61.0],
    [38.0, 70.0, 160.0],
    [31.0, 148.0, 140.0],
    [122.0, 209.0, 81.0],
    [253.0, 231.0, 37.0],
    [240.0, 60.0, 40.0],
];

/// `[height * width * 3]`, 8 bit.
pub fn rgb_png(width: u32, height: u32, rgb: &[u8]) -> Vec<u8> {
    png(width, height, rgb, ExtendedColorType::Rgb8)
}

/// `[height * width]` metres as 16-bit grey millimetres; what is farther than 65 m is 65,535.
pub fn depth_png(width: u32, height: u32, metres: &[f32]) -> Vec<u8> {
    let samples: Vec<u8> = metres
        .iter()
        .flat_map(|metres| ((metres * 1000.0).round().clamp(0.0, 65_535.0) as u16).to_ne_bytes())
        .collect();
    png(width, height, &samples, ExtendedColorType::L16)
}

/// `[height * width]` relevancies in 0..1 as colors.
pub fn heatmap_png(width: u32, height: u32, values: &[f32]) -> Vec<u8> {
    let rgb: Vec<u8> = values.iter().flat_map(|value| heat(*value)).collect();
    rgb_png(width, height, &rgb)
}

fn heat(value: f32) -> [u8; 3] {
    let place = value.clamp(0.0, 1.0) * (HEAT.len() - 1) as f32;
    // A NaN becomes the first color.
    let below = (place as usize).min(HEAT.len() - 2);
    let share = place - below as f32;
    std::array::from_fn(|channel| {
        let (a, b) = (HEAT[below][channel], HEAT[below + 1][channel]);
        (a + (b - a) * share).round() as u8
    })
}

fn png(width: u32, height: u32, data: &[u8], color: ExtendedColorType) -> Vec<u8> {
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, CompressionType::Fast, FilterType::Adaptive)
        .write_image(data, width, height, color)
        .expect("the data have the size that is said, and memory takes all bytes");
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_sixteen_bit_millimetres() {
        let file = depth_png(2, 2, &[0.0, 1.2345, 70.0, f32::NAN]);
        let image = image::load_from_memory(&file).unwrap();
        let image::DynamicImage::ImageLuma16(grey) = image else { panic!("not 16 bit") };
        assert_eq!(grey.into_raw(), [0, 1235, 65_535, 0]);
    }

    #[test]
    fn heat_runs_from_dark_to_red() {
        assert_eq!(heat(0.0), [24, 15, 61]);
        assert_eq!(heat(1.0), [240, 60, 40]);
        assert_eq!(heat(7.0), heat(1.0));
        assert_eq!(heat(0.2), [38, 70, 160]);
        assert_ne!(heat(0.5), heat(0.55));
        let file = heatmap_png(2, 1, &[0.0, 1.0]);
        let image = image::load_from_memory(&file).unwrap().into_rgb8();
        assert_eq!(image.into_raw(), [24, 15, 61, 240, 60, 40]);
    }
}
