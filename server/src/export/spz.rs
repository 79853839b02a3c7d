//! `splats.spz`: SPZ version 3, Niantic's format for compressed splats
//! (<https://github.com/nianticlabs/spz>), about a tenth of the size of the PLY.
//!
//! The file is gzipped: a header of 16 bytes, then one array for each attribute. Positions are
//! 24-bit fixed point, with as many fractional bits as the map's farthest Gaussian leaves; opacities and
//! colors are bytes; scales are bytes of the logarithm; rotations are the three smallest components of the
//! quaternion in 32 bits. The axes of SPZ are right, up, back; those of the map's world are right, down,
//! forward, so that y and z are negated. Losses: 3 % of a scale, 0.1 degrees, and of a position half a
//! step: 0.12 mm up to 2 km from the origin, 1 mm up to 16 km. A map that is farther away is refused.

use super::splat::{Splat, byte, splats};
use flate2::Compression;
use flate2::write::GzEncoder;
use lexsplat_gpu::HostGaussians;
use std::io::Write as _;

/// "NGSP" in ASCII.
const MAGIC: u32 = 0x5053_474e;
const VERSION: u32 = 3;
/// Most fractional bits of a position: steps of a quarter of a millimetre, up to 2 km from the origin.
const FINEST_BITS: u8 = 12;
/// Fewest fractional bits: steps of 2 mm, up to 16 km. Coarser ones would spoil small Gaussians.
const COARSEST_BITS: u8 = 9;
/// The largest signed 24-bit number.
const MAX_FIXED: f32 = 8_388_607.0;
/// Colors are bytes of 0.5 + COLOR_SCALE * coefficient of the harmonic.
const COLOR_SCALE: f32 = 0.15;
/// The largest magnitude of a quaternion's component, 9 bits, for `sqrt(1/2)`.
const MAX_COMPONENT: f32 = 511.0;

/// A map is too far from the origin for 24 bits.
#[derive(Debug, thiserror::Error)]
#[error(
    "splats.spz: a Gaussian is {metres:.0} m from the origin, and 24 bits hold a position to 2 mm only up to \
     16383 m: export splats.ply or splats.glb, or give poses in a frame of reference near the map"
)]
pub struct TooFar {
    /// Largest coordinate, metres.
    pub metres: f32,
}

/// The color heads as `splats.spz`.
///
/// # Errors
/// [`TooFar`].
pub(super) fn splats_spz(gaussians: &HostGaussians) -> Result<Vec<u8>, TooFar> {
    let bits = fractional_bits(gaussians)?;
    let mut gzip = GzEncoder::new(Vec::new(), Compression::default());
    gzip.write_all(&unzipped(gaussians, bits)).expect("a vector takes all bytes");
    Ok(gzip.finish().expect("a vector takes all bytes"))
}

/// Bits behind the point, so that every coordinate fits.
fn fractional_bits(gaussians: &HostGaussians) -> Result<u8, TooFar> {
    let coordinates = gaussians.means.iter().flatten().map(|value| value.abs());
    let metres = coordinates.filter(|value| value.is_finite()).fold(0.0, f32::max);
    let fits = |bits: &u8| (metres * steps(*bits)).round() <= MAX_FIXED;
    (COARSEST_BITS..=FINEST_BITS).rev().find(fits).ok_or(TooFar { metres })
}

/// Steps of a position in a metre.
fn steps(bits: u8) -> f32 {
    f32::from(1_u16 << bits)
}

fn unzipped(gaussians: &HostGaussians, bits: u8) -> Vec<u8> {
    let all = splats(gaussians);
    let count = u32::try_from(all.len()).expect("a map has fewer than 2^32 Gaussians");
    // Bytes of a Gaussian: position, opacity, color, scale, rotation.
    let mut out = Vec::with_capacity(16 + all.len() * (9 + 1 + 3 + 3 + 4));
    for word in [MAGIC, VERSION, count] {
        out.extend(word.to_le_bytes());
    }
    let (harmonics_degree, flags, reserved) = (0, 0, 0);
    out.extend([harmonics_degree, bits, flags, reserved]);
    out.extend(all.clone().flat_map(|splat| position(&splat, bits)));
    out.extend(all.clone().map(|splat| byte(splat.opacity())));
    out.extend(all.clone().flat_map(|s| s.harmonics().map(|f_dc| byte(f_dc * COLOR_SCALE + 0.5))));
    out.extend(
        all.clone().flat_map(|s| s.log_scale.map(|log| ((log + 10.0) * 16.0).round() as u8)),
    );
    out.extend(all.flat_map(|splat| rotation(&splat).to_le_bytes()));
    out
}

/// Fixed point with negated y and z.
fn position(splat: &Splat, bits: u8) -> [u8; 9] {
    let [x, y, z] = splat.position;
    let mut out = [0; 9];
    for (value, bytes) in [x, -y, -z].into_iter().zip(out.chunks_exact_mut(3)) {
        let fixed = (value * steps(bits)).round().clamp(-MAX_FIXED, MAX_FIXED) as i32;
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

    fn unpacked_file(gaussians: &HostGaussians) -> Vec<u8> {
        let (mut file, zipped) = (Vec::new(), splats_spz(gaussians).unwrap());
        flate2::read::GzDecoder::new(&zipped[..]).read_to_end(&mut file).unwrap();
        file
    }

    /// Positions by the rule of the specification, in the map's axes, and the fractional bits.
    fn positions(file: &[u8]) -> (u8, Vec<[f32; 3]>) {
        let bits = file[13];
        let number = |bytes: &[u8]| {
            (i32::from_le_bytes([0, bytes[0], bytes[1], bytes[2]]) >> 8) as f32 / steps(bits)
        };
        let [first, second] = [&file[16..25], &file[25..34]]
            .map(|nine| [number(&nine[..3]), -number(&nine[3..6]), -number(&nine[6..])]);
        (bits, vec![first, second])
    }

    #[test]
    fn far_positions_are_kept_or_refused() {
        for (metres, bits) in
            [(0.0, 12), (2047.0, 12), (2049.0, 11), (-5000.0, 10), (9000.0, 9), (16_383.0, 9)]
        {
            let mut far = two();
            far.means = vec![[metres, 0.126, -0.002], [0.0, -metres, metres + 0.25]];
            let (found, positions) = positions(&unpacked_file(&far));
            assert_eq!(found, bits, "{metres}");
            for (read, written) in positions.iter().flatten().zip(far.means.iter().flatten()) {
                assert!((read - written).abs() <= 0.5 / steps(bits), "{read} for {written}");
            }
        }
        let mut far = two();
        far.means[1][2] = -16_385.0;
        let error = splats_spz(&far).unwrap_err().to_string();
        assert!(error.contains("16385 m from the origin"), "{error}");
        // What is nowhere does not decide about the others.
        far.means[1][2] = f32::NAN;
        assert_eq!(positions(&unpacked_file(&far)).0, 12);
    }

    #[test]
    fn attributes_are_laid_out_as_specified() {
        let file = unpacked_file(&two());
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
