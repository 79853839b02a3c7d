//! `splats.spz`: SPZ version 3, Niantic's format for compressed splats
//! (<https://github.com/nianticlabs/spz>), about a tenth of the size of the PLY.
//!
//! The file is gzipped: a header of 16 bytes, then one array for each attribute. Positions are
//! 24-bit fixed point; opacities and colors are bytes; scales are bytes of the logarithm; rotations
//! are the three smallest components of the quaternion in 32 bits. The axes of SPZ are right, up,
//! back; those of the map's world are right, down, forward, so that y and z are negated. Losses:
//! half a millimetre, 3 % of a scale, 0.1 degrees.

use super::splat::{Splat, byte, splats};
use flate2::Compression;
use flate2::write::GzEncoder;
use lexsplat_gpu::HostGaussians;
use std::io::Write as _;

/// "NGSP" in ASCII.
const MAGIC: u32 = 0x5053_474e;
const VERSION: u32 = 3;
/// Fractional bits of a position: steps of a quarter of a millimetre, up to 2 km from the origin.
const FRACTIONAL_BITS: u8 = 12;
/// The largest signed 24-bit number.
const MAX_FIXED: f32 = 8_388_607.0;
/// Colors are bytes of 0.5 + COLOR_SCALE * coefficient of the harmonic.
const COLOR_SCALE: f32 = 0.15;
/// The largest magnitude of a quaternion's component, 9 bits, for `sqrt(1/2)`.
const MAX_COMPONENT: f32 = 511.0;

/// The color heads as `splats.spz`.
pub(super) fn splats_spz(gaussians: &HostGaussians) -> Vec<u8> {
    let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
    gzip.write_all(&unzipped(gaussians)).expect("a vector takes all bytes");
    gzip.finish().expect("a vector takes all bytes")
}

fn unzipped(gaussians: &HostGaussians) -> Vec<u8> {
    let all = splats(gaussians);
    let count = u32::try_from(all.len()).expect("a map has fewer than 2^32 Gaussians");
    // Bytes of a Gaussian: position, opacity, color, scale, rotation.
    let mut out = Vec::with_capacity(16 + all.len() * (9 + 1 + 3 + 3 + 4));
    for word in [MAGIC, VERSION, count] {
        out.extend(word.to_le_bytes());
    }
    let (harmonics_degree, flags, reserved) = (0, 0, 0);
    out.extend([harmonics_degree, FRACTIONAL_BITS, flags, reserved]);
    out.extend(all.clone().flat_map(|splat| position(&splat)));
    out.extend(all.clone().map(|splat| byte(splat.opacity())));
    out.extend(all.clone().flat_map(|s| s.harmonics().map(|f_dc| byte(f_dc * COLOR_SCALE + 0.5))));
    out.extend(
        all.clone().flat_map(|s| s.log_scale.map(|log| ((log + 10.0) * 16.0).round() as u8)),
    );
    out.extend(all.flat_map(|splat| rotation(&splat).to_le_bytes()));
    out
}

/// Fixed point with negated y and z; values out of range are clamped.
fn position(splat: &Splat) -> [u8; 9] {
    let [x, y, z] = splat.position;
    let mut out = [0; 9];
    for (value, bytes) in [x, -y, -z].into_iter().zip(out.chunks_exact_mut(3)) {
        let fixed = (value * f32::from(1_u16 << FRACTIONAL_BITS)).round();
        let fixed = fixed.clamp(-MAX_FIXED, MAX_FIXED) as i32;
        bytes.copy_from_slice(&fixed.to_le_bytes()[..3]);
    }
    out
}

/// The index of the largest of (x, y, z, w) in two bits, then the other three in order, each a sign
/// and 9 bits. The quaternion is negated if the largest component is negative.
fn rotation(splat: &Splat) -> u32 {
    // Half a turn about x takes right, down, forward to right, up, back.
    let [w, x, y, z] = splat.rotation;
    let parts = [x, -y, -z, w];
    let largest = (0..4).max_by(|&a, &b| parts[a].abs().total_cmp(&parts[b].abs())).unwrap_or(3);
    let sign = parts[largest].signum();
    (0..4).filter(|&at| at != largest).fold(largest as u32, |packed, at| {
        let part = parts[at] * sign * std::f32::consts::SQRT_2;
        let magnitude = (part.abs() * MAX_COMPONENT).round().min(MAX_COMPONENT) as u32;
        (packed << 10) | (u32::from(part < 0.0) << 9) | magnitude
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::splat::samples::two;
    use std::io::Read as _;

    /// Unpacks a rotation (x, y, z, w) by the rule of the specification.
    fn unpacked(mut packed: u32) -> [f32; 4] {
        let largest = (packed >> 30) as usize;
        let (mut parts, mut squares) = ([0.0_f32; 4], 0.0);
        for at in (0..4).rev().filter(|&at| at != largest) {
            let magnitude = (packed & 511) as f32 / 511.0 * std::f32::consts::FRAC_1_SQRT_2;
            parts[at] = if packed & 512 == 0 { magnitude } else { -magnitude };
            squares += magnitude * magnitude;
            packed >>= 10;
        }
        parts[largest] = (1.0 - squares).max(0.0).sqrt();
        parts
    }

    #[test]
    fn attributes_are_laid_out_as_specified() {
        let mut file = Vec::new();
        let zipped = splats_spz(&two());
        flate2::read::GzDecoder::new(&zipped[..]).read_to_end(&mut file).unwrap();
        assert_eq!(file.len(), 16 + 2 * 20);
        assert_eq!(&file[..16], b"NGSP\x03\0\0\0\x02\0\0\0\0\x0c\0\0");
        let fixed = |at: usize| i32::from_le_bytes([0, file[at], file[at + 1], file[at + 2]]) >> 8;
        let found: Vec<i32> = (0..6).map(|i| fixed(16 + 3 * i)).collect();
        assert_eq!(found, [1, -2, -3, 4, -5, -6].map(|metres| metres * 4096));
        // sigmoid(0.25) and sigmoid(-0.5) as bytes.
        assert_eq!(file[34..36], [143, 96]);
        // 0.5 + 0.15 (rgb - 0.5) / 0.28209: 0.766, 0.5, 0.234; 0.340, 0.447, 1.138 clamped.
        assert_eq!(file[36..42], [195, 128, 60, 87, 114, 255]);
        assert_eq!(file[42..48], [144, 128, 112, 144, 128, 112]);
    }

    #[test]
    fn rotations_are_converted_to_the_axes_of_spz() {
        for quaternion in [
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 0.6, 0.0, 0.8],
            [0.5, -0.5, 0.5, 0.5],
            [0.1, 0.7, -0.7, 0.1],
        ] {
            let norm = quaternion.iter().map(|part: &f32| part * part).sum::<f32>().sqrt();
            let [w, x, y, z] = quaternion.map(|part| part / norm);
            let splat = Splat {
                position: [0.0; 3],
                rgb: [0.5; 3],
                log_scale: [0.0; 3],
                rotation: [w, x, y, z],
                opacity_logit: 0.0,
            };
            let found = unpacked(rotation(&splat));
            let dot =
                |other: [f32; 4]| found.iter().zip(other).map(|(a, b)| a * b).sum::<f32>().abs();
            assert!(dot([x, -y, -z, w]) > 0.999_99, "{quaternion:?} {found:?}");
            // Negative control: without the conversion the rotation differs, except about x.
            assert!(dot([x, y, z, w]) < 0.9 || (y == 0.0 && z == 0.0), "{quaternion:?}");
        }
    }
}
