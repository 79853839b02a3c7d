//! Color heads as splat formats store them. In: the Gaussians of a snapshot. Out: values that are
//! common to PLY, SPZ and glTF.

use lexsplat_gpu::HostGaussians;

/// The zeroth spherical harmonic: color = 0.5 + SH_0 * coefficient.
const SH_0: f32 = 0.282_094_79;

/// The color head of a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Splat {
    /// Metres, in the map's world.
    pub position: [f32; 3],
    /// Red, green, blue; the displayable range is 0..1.
    pub rgb: [f32; 3],
    /// Natural logarithms of the standard deviations, metres.
    pub log_scale: [f32; 3],
    /// (w, x, y, z), unit length.
    pub rotation: [f32; 4],
    /// Logit of the opacity.
    pub opacity_logit: f32,
}

impl Splat {
    /// Coefficients of the zeroth spherical harmonic.
    pub(super) fn harmonics(&self) -> [f32; 3] {
        self.rgb.map(|value| (value - 0.5) / SH_0)
    }

    /// Opacity, 0..1.
    pub(super) fn opacity(&self) -> f32 {
        1.0 / (1.0 + (-self.opacity_logit).exp())
    }
}

/// All Gaussians, in the map's order.
pub(super) fn splats(gaussians: &HostGaussians) -> impl ExactSizeIterator<Item = Splat> + Clone {
    let head = &gaussians.color;
    gaussians.means.iter().enumerate().map(move |(at, &position)| {
        let rgb = &head.features[at * head.channels..][..3];
        Splat {
            position,
            rgb: [rgb[0], rgb[1], rgb[2]],
            log_scale: head.log_scales[at],
            rotation: unit(head.rotations[at]),
            opacity_logit: head.opacity_logits[at],
        }
    })
}

fn unit(quaternion: [f32; 4]) -> [f32; 4] {
    let norm = quaternion.iter().map(|part| part * part).sum::<f32>().sqrt();
    quaternion.map(|part| part / norm.max(f32::MIN_POSITIVE))
}

/// 0..1 to 0..255. Values beyond the range are clamped; NaN becomes 0.
pub(super) fn byte(value: f32) -> u8 {
    (value * 255.0).round() as u8
}

#[cfg(test)]
pub(super) mod samples {
    //! Gaussians for the tests of all formats.

    use lexsplat_gpu::{HostGaussians, HostHead};

    /// Two Gaussians, with rotations that have no unit length and colors beyond the range.
    pub(in crate::export) fn two() -> HostGaussians {
        let head = |channels| HostHead {
            rotations: vec![[2.0, 0.0, 0.0, 0.0], [0.0, 3.0, 0.0, 4.0]],
            log_scales: vec![[-1.0, -2.0, -3.0]; 2],
            opacity_logits: vec![0.25, -0.5],
            features: vec![0.5; 2 * channels],
            channels,
        };
        let mut color = head(3);
        color.features = vec![1.0, 0.5, 0.0, 0.2, 0.4, 1.7];
        HostGaussians { means: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], color, language: head(15) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_have_unit_length_and_colors_become_harmonics() {
        let all: Vec<Splat> = splats(&samples::two()).collect();
        assert_eq!(all[1].rotation, [0.0, 0.6, 0.0, 0.8]);
        let [red, green, blue] = all[0].harmonics();
        assert!((red - 1.772_45).abs() < 1e-4 && green == 0.0 && (blue + 1.772_45).abs() < 1e-4);
        assert!((all[0].opacity() - 0.562_177).abs() < 1e-5);
        assert_eq!([byte(-0.2), byte(0.5), byte(1.7), byte(f32::NAN)], [0, 128, 255, 0]);
    }
}
