//! `splats.splat`: 32 bytes for each Gaussian and no header, the format that web viewers stream.
//!
//! A record is the position (3 × float32, metres, in the map's world), the standard deviations (3 × float32,
//! metres), red, green, blue and opacity (4 × uint8), and the rotation (w, x, y, z as `128 + 128 q`, 4 × uint8).
//! What is most to be seen comes first, so that any first part of the file shows the whole map coarsely.

use super::splat::{Splat, byte, splats};
use lexsplat_gpu::HostGaussians;

/// Bytes of a Gaussian.
const RECORD: usize = 32;

/// The color heads as `splats.splat`.
pub(super) fn splats_splat(gaussians: &HostGaussians) -> Vec<u8> {
    let mut all: Vec<(f32, Splat)> =
        splats(gaussians).map(|splat| (importance(&splat), splat)).collect();
    all.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let mut out = Vec::with_capacity(all.len() * RECORD);
    for (_, splat) in &all {
        let floats = splat.position.into_iter().chain(splat.log_scale.map(f32::exp));
        out.extend(floats.flat_map(f32::to_le_bytes));
        out.extend(splat.rgb.map(byte));
        out.push(byte(splat.opacity()));
        out.extend(splat.rotation.map(|part| (part * 128.0 + 128.0).round() as u8));
    }
    out
}

/// Opacity times the area of the largest section through the Gaussian. What is nowhere comes last.
fn importance(splat: &Splat) -> f32 {
    let [a, b, c] = splat.log_scale;
    let area = (a + b + c - a.min(b).min(c)).exp();
    let seen = splat.opacity() * area;
    if seen.is_finite() && splat.position.iter().all(|part| part.is_finite()) { seen } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::splat::samples::two;

    fn floats(record: &[u8]) -> Vec<f32> {
        record[..24]
            .chunks_exact(4)
            .map(|four| f32::from_le_bytes(four.try_into().unwrap()))
            .collect()
    }

    #[test]
    fn records_have_the_layout_of_the_format() {
        let file = splats_splat(&two());
        assert_eq!(file.len(), 2 * RECORD);
        let first = floats(&file);
        assert_eq!(first[..3], [1.0, 2.0, 3.0]);
        for (scale, log) in first[3..].iter().zip([-1.0_f32, -2.0, -3.0]) {
            assert!((scale - log.exp()).abs() < 1e-6, "{scale}");
        }
        // sigmoid(0.25) is 143 of 255; a rotation by nothing is (1, 0, 0, 0).
        assert_eq!(file[24..32], [255, 128, 0, 143, 255, 128, 128, 128]);
        // (0, 0.6, 0, 0.8), and a blue beyond the range.
        assert_eq!(file[RECORD + 24..], [51, 102, 255, 96, 128, 205, 128, 230]);
    }

    #[test]
    fn what_is_most_to_be_seen_comes_first() {
        let order = |gaussians: &HostGaussians| {
            let file = splats_splat(gaussians);
            [floats(&file)[0], floats(&file[RECORD..])[0]]
        };
        assert_eq!(order(&two()), [1.0, 4.0], "the same size: the more opaque one");
        let mut wide = two();
        wide.color.log_scales[1] = [-1.0, -1.0, -9.0];
        assert_eq!(order(&wide), [4.0, 1.0], "a wide disk");
        let mut long = two();
        long.color.log_scales[1] = [0.0, -9.0, -9.0];
        assert_eq!(order(&long), [1.0, 4.0], "a needle");
        wide.means[1][2] = f32::NAN;
        assert_eq!(order(&wide), [1.0, 4.0], "nowhere");
    }
}
