//! A clean frame, decoded: linear light and metres of each pixel.

use lexsplat_client::dataset::{DatasetError, Intrinsics, RgbdFrame};

/// The pictures of a frame as numbers, row by row.
#[derive(Clone, Debug)]
pub(super) struct Clean {
    pub camera: Intrinsics,
    /// Linear RGB, 0 to 1.
    pub light: Vec<[f32; 3]>,
    /// Camera z, metres; 0 without a measurement.
    pub depth: Vec<f32>,
}

impl Clean {
    /// Decodes a frame.
    pub fn of(
        frame: &RgbdFrame,
        camera: Intrinsics,
        unit_metres: f64,
    ) -> Result<Self, DatasetError> {
        let (light, depth) = (light(frame, &camera)?, frame.depth_metres(unit_metres)?);
        let expected = camera.width as usize * camera.height as usize;
        for found in [light.len(), depth.len()] {
            if found != expected {
                return Err(DatasetError::Pixels { sequence: frame.sequence, expected, found });
            }
        }
        Ok(Self { camera, light, depth })
    }

    pub fn width(&self) -> usize {
        self.camera.width as usize
    }

    pub fn height(&self) -> usize {
        self.camera.height as usize
    }

    /// Brightness of a pixel, which stands in for its reflectance in infrared.
    pub fn brightness(&self, pixel: usize) -> f32 {
        luminance(self.light[pixel])
    }
}

/// Mean brightness of a frame's picture, linear.
pub(super) fn mean_brightness(frame: &RgbdFrame, camera: &Intrinsics) -> Result<f32, DatasetError> {
    let light = light(frame, camera)?;
    let sum: f64 = light.iter().map(|rgb| f64::from(luminance(*rgb))).sum();
    Ok((sum / light.len().max(1) as f64) as f32)
}

fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

fn light(frame: &RgbdFrame, camera: &Intrinsics) -> Result<Vec<[f32; 3]>, DatasetError> {
    let linear: [f32; 256] = std::array::from_fn(|byte| from_srgb(byte as f32 / 255.0));
    let picture = frame.rgb(camera)?;
    Ok(picture.pixels().map(|pixel| pixel.0.map(|byte| linear[usize::from(byte)])).collect())
}

fn from_srgb(s: f32) -> f32 {
    if s <= 0.040_45 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
}

/// The sRGB byte of linear light; what is above 1 is clipped.
pub(super) fn srgb_byte(light: f32) -> u8 {
    let light = light.clamp(0.0, 1.0);
    let s =
        if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
    (s * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_survive_the_way_to_light_and_back() {
        for byte in 0..=255 {
            assert_eq!(srgb_byte(from_srgb(f32::from(byte) / 255.0)), byte);
        }
        assert_eq!((srgb_byte(1.7), srgb_byte(-0.1)), (255, 0));
    }
}
