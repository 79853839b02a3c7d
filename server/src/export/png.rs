//! PNG files: colors, depths in millimetres, and heat maps.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};

/// Color map of heat maps from 0 to 1: dark blue, blue, green, yellow, red. Lightness increases up
/// to yellow, so that it can also be read in grey.
const COLOR_MAP: [[f32; 3]; 6] = [
    [24.0, 15.0, 61.0],
    [38.0, 70.0, 160.0],
    [31.0, 148.0, 140.0],
    [122.0, 209.0, 81.0],
    [253.0, 231.0, 37.0],
    [240.0, 60.0, 40.0],
];

/// Pixels `[height * width * 3]`, 8 bit.
pub fn rgb_png(width: u32, height: u32, rgb: &[u8]) -> Vec<u8> {
    png(width, height, rgb, ExtendedColorType::Rgb8)
}

/// Depths `[height * width]`, metres, as 16-bit grey millimetres. Depths beyond 65.535 m are
/// 65,535.
pub fn depth_png(width: u32, height: u32, metres: &[f32]) -> Vec<u8> {
    let samples: Vec<u8> = metres
        .iter()
        .flat_map(|metres| ((metres * 1000.0).round().clamp(0.0, 65_535.0) as u16).to_ne_bytes())
        .collect();
    png(width, height, &samples, ExtendedColorType::L16)
}

/// Relevancies `[height * width]`, 0..1, as colors.
pub fn heatmap_png(width: u32, height: u32, values: &[f32]) -> Vec<u8> {
    let rgb: Vec<u8> = values.iter().flat_map(|value| color(*value)).collect();
    rgb_png(width, height, &rgb)
}

fn color(value: f32) -> [u8; 3] {
    let position = value.clamp(0.0, 1.0) * (COLOR_MAP.len() - 1) as f32;
    // NaN has the first color.
    let below = (position as usize).min(COLOR_MAP.len() - 2);
    let share = position - below as f32;
    std::array::from_fn(|channel| {
        let (a, b) = (COLOR_MAP[below][channel], COLOR_MAP[below + 1][channel]);
        (a + (b - a) * share).round() as u8
    })
}

fn png(width: u32, height: u32, data: &[u8], kind: ExtendedColorType) -> Vec<u8> {
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, CompressionType::Fast, FilterType::Adaptive)
        .write_image(data, width, height, kind)
        .expect("the data have this size, and a vector takes all bytes");
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
    fn heat_maps_run_from_dark_blue_to_red() {
        assert_eq!(color(0.0), [24, 15, 61]);
        assert_eq!(color(1.0), [240, 60, 40]);
        assert_eq!(color(7.0), color(1.0));
        assert_eq!(color(0.2), [38, 70, 160]);
        assert_ne!(color(0.5), color(0.55));
        let file = heatmap_png(2, 1, &[0.0, 1.0]);
        let image = image::load_from_memory(&file).unwrap().into_rgb8();
        assert_eq!(image.into_raw(), [24, 15, 61, 240, 60, 40]);
    }
}
