//! Labels of a segmentation as an indexed PNG and as PLY points.
//!
//! Label 0, "none of the texts", is transparent in images and grey in points.

use super::ply;
use crate::pipeline::query::LabelledPoint;
use png::{BitDepth, ColorType, Encoder};

/// Turns of the color wheel from one label to the next: with the golden angle, colors do not
/// repeat.
const TURN: f32 = 0.618_034;
/// Color of points without a label.
const UNLABELLED: [u8; 3] = [128, 128, 128];

/// The color of a label. Label 0 is black, because it is transparent.
pub fn label_color(label: usize) -> [u8; 3] {
    if label == 0 {
        return [0; 3];
    }
    let hue = (label as f32 * TURN).fract() * 6.0;
    // Even labels are paler, so that neighbours on the wheel also differ in saturation.
    let (value, saturation) = if label % 2 == 1 { (0.95, 0.85) } else { (0.85, 0.55) };
    // HSV to RGB, for each channel.
    [5.0, 3.0, 1.0].map(|shift: f32| {
        let k = (shift + hue) % 6.0;
        let part = k.min(4.0 - k).clamp(0.0, 1.0);
        super::splat::byte(value * (1.0 - saturation * part))
    })
}

/// Labels `[height * width]` as an indexed PNG: the values of the pixels are the labels.
pub fn labels_png(width: u32, height: u32, labels: &[u8]) -> Vec<u8> {
    let most = labels.iter().copied().max().unwrap_or(0);
    let mut out = Vec::new();
    let mut encoder = Encoder::new(&mut out, width, height);
    encoder.set_color(ColorType::Indexed);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_palette((0..=usize::from(most)).flat_map(label_color).collect::<Vec<_>>());
    encoder.set_trns(&[0][..]);
    let mut writer = encoder.write_header().expect("a vector takes all bytes");
    writer.write_image_data(labels).expect("the labels have this size");
    drop(writer);
    out
}

/// Labelled points as PLY: `x y z red green blue label score`.
pub fn labelled_points_ply(points: &[LabelledPoint]) -> Vec<u8> {
    let properties: [(&str, &[&str]); 3] = [
        ("float", &["x", "y", "z"]),
        ("uchar", &["red", "green", "blue", "label"]),
        ("float", &["score"]),
    ];
    let mut out = ply::header(points.len(), &properties, None);
    for point in points {
        ply::put(&mut out, point.position.coords.as_slice());
        out.extend(if point.label == 0 { UNLABELLED } else { label_color(point.label.into()) });
        out.push(point.label);
        ply::put(&mut out, &[point.score]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn values_of_pixels_are_labels_and_colors_differ() {
        let file = labels_png(3, 2, &[0, 1, 2, 3, 1, 0]);
        let shown = image::load_from_memory(&file).unwrap().into_rgba8();
        assert_eq!(shown.get_pixel(0, 0)[3], 0, "label 0 is transparent");
        assert_eq!(shown.get_pixel(1, 0), shown.get_pixel(1, 1));
        assert_eq!(shown.get_pixel(2, 0).0[..3], label_color(2));
        let mut decoder = png::Decoder::new(std::io::Cursor::new(&file));
        decoder.set_transformations(png::Transformations::IDENTITY);
        let mut reader = decoder.read_info().unwrap();
        let mut values = vec![0; 6];
        reader.next_frame(&mut values).unwrap();
        assert_eq!(values, [0, 1, 2, 3, 1, 0]);
        for a in 1..=32 {
            for b in 1..a {
                let apart: i32 = label_color(a)
                    .iter()
                    .zip(label_color(b))
                    .map(|(&a, b)| (i32::from(a) - i32::from(b)).abs())
                    .sum();
                assert!(apart > 20, "labels {a} and {b}: {apart}");
            }
        }
    }

    #[test]
    fn points_have_color_label_and_score() {
        let point =
            |label| LabelledPoint { position: Point3::new(1.0, 2.0, 3.0), label, score: 0.5 };
        let file = labelled_points_ply(&[point(0), point(4)]);
        let data = &file[file.len() - 2 * 20..];
        assert_eq!(data[12..16], [128, 128, 128, 0]);
        assert_eq!((&data[32..35], data[35]), (&label_color(4)[..], 4));
        assert_eq!(data[36..40], 0.5_f32.to_le_bytes());
    }
}
