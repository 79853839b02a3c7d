//! The pictures of a frame as pixels, whatever they are encoded in.

use super::error::DatasetError;
use super::frame::{ColorFormat, DepthFormat, Intrinsics, RgbdFrame};
use image::{ImageFormat, RgbImage};

impl RgbdFrame {
    /// The color image, of the color camera's size.
    ///
    /// # Errors
    /// [`DatasetError`] if it cannot be decoded, or is raw and of another size.
    pub fn rgb(&self, camera: &Intrinsics) -> Result<RgbImage, DatasetError> {
        let (sequence, bytes) = (self.sequence, &self.color.bytes);
        if self.color.format != ColorFormat::Rgb8 {
            let decoded = image::load_from_memory(bytes);
            return decoded
                .map(|picture| picture.to_rgb8())
                .map_err(|source| DatasetError::Decode { sequence, source });
        }
        let found = bytes.len() / 3;
        RgbImage::from_raw(camera.width, camera.height, bytes.clone()).ok_or(DatasetError::Pixels {
            sequence,
            expected: camera.width as usize * camera.height as usize,
            found,
        })
    }

    /// The depth image, metres, row by row; 0 without a measurement.
    ///
    /// # Errors
    /// [`DatasetError`] if it cannot be decoded.
    pub fn depth_metres(&self, unit_metres: f64) -> Result<Vec<f32>, DatasetError> {
        let bytes = &self.depth.bytes;
        // 65535 means no measurement or out of range.
        let metres = |units: u16| match units {
            u16::MAX => 0.0,
            units => (f64::from(units) * unit_metres) as f32,
        };
        let plain = |bytes: &[u8]| {
            let pairs = bytes.chunks_exact(2);
            pairs.map(|pair| metres(u16::from_le_bytes([pair[0], pair[1]]))).collect()
        };
        let failed = |source| DatasetError::Decode { sequence: self.sequence, source };
        Ok(match self.depth.format {
            DepthFormat::Png16 | DepthFormat::Unspecified => {
                let picture = image::load_from_memory_with_format(bytes, ImageFormat::Png);
                picture.map_err(failed)?.to_luma16().as_raw().iter().copied().map(metres).collect()
            }
            DepthFormat::U16 => plain(bytes),
            DepthFormat::U16Zstd => {
                let whole = zstd::decode_all(&bytes[..]).map_err(image::ImageError::IoError);
                plain(&whole.map_err(failed)?)
            }
            DepthFormat::F32Metres => {
                let fours = bytes.chunks_exact(4);
                let numbers = fours.map(|n| f32::from_le_bytes([n[0], n[1], n[2], n[3]]));
                numbers.map(|metres| if metres > 0.0 { metres } else { 0.0 }).collect()
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{Color, Depth, FrameExtras};

    fn frame(color: (ColorFormat, Vec<u8>), depth: (DepthFormat, Vec<u8>)) -> RgbdFrame {
        RgbdFrame {
            sequence: 3,
            timestamp_nanos: 0,
            color: Color { format: color.0, bytes: color.1 },
            depth: Depth { format: depth.0, bytes: depth.1 },
            world_from_camera: None,
            extras: FrameExtras::default(),
        }
    }

    const CAMERA: Intrinsics =
        Intrinsics { width: 2, height: 1, fx: 1.0, fy: 1.0, cx: 0.5, cy: 0.0 };

    #[test]
    fn every_format_gives_the_same_pixels() {
        let png = |bytes: &[u8], color| {
            let mut encoded = Vec::new();
            let encoder = image::codecs::png::PngEncoder::new(&mut encoded);
            image::ImageEncoder::write_image(encoder, bytes, 2, 1, color).unwrap();
            encoded
        };
        let rgb = vec![1, 2, 3, 4, 5, 6];
        let units = [1500_u16, u16::MAX].map(u16::to_le_bytes).concat();
        let samples = [1500_u16, u16::MAX].map(u16::to_ne_bytes).concat();
        let metres = [1.5_f32, f32::NAN].map(f32::to_le_bytes).concat();
        for depth in [
            (DepthFormat::U16, units.clone()),
            (DepthFormat::U16Zstd, zstd::encode_all(&units[..], 1).unwrap()),
            (DepthFormat::Png16, png(&samples, image::ExtendedColorType::L16)),
            (DepthFormat::F32Metres, metres),
        ] {
            for color in [
                (ColorFormat::Rgb8, rgb.clone()),
                (ColorFormat::Png, png(&rgb, image::ExtendedColorType::Rgb8)),
            ] {
                let frame = frame(color, depth.clone());
                assert_eq!(frame.rgb(&CAMERA).unwrap().as_raw(), &rgb);
                assert_eq!(frame.depth_metres(0.001).unwrap(), [1.5, 0.0], "{:?}", depth.0);
            }
        }
        // Negative controls: too few pixels, and no picture.
        let short = frame((ColorFormat::Rgb8, vec![1, 2, 3]), (DepthFormat::Png16, vec![1]));
        assert!(matches!(
            short.rgb(&CAMERA),
            Err(DatasetError::Pixels { expected: 2, found: 1, .. })
        ));
        assert!(short.depth_metres(0.001).is_err());
    }
}
