//! What an object looks like: the shares of colors on its surface, and its lightness.

use super::color::{Lab, names};
use crate::pipeline::query::question::Color;
use lexsplat_gpu::HostGaussians;

/// Share of the surface from which on an object has a color.
const LEAST_SHARE: f32 = 0.25;
/// The same, as a share of what the object with the most of this color has: beside a red chair, one with a red
/// cushion is not the red one.
const OF_MOST: f32 = 0.5;
/// Lightness (Oklab) below which most of a dark thing is, and above which most of a light one is.
const DARK: f32 = 0.5;
const LIGHT: f32 = 0.68;

/// Colors of an object.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Look {
    /// For each of [`Color::ALL`], the share of the surface that may be called so, 0..1.
    shares: [f32; Color::ALL.len()],
    /// Median.
    lightness: f32,
}

impl Look {
    /// Of the Gaussians with these indices. Each counts by its area, as far as it is opaque.
    pub(super) fn new(gaussians: &HostGaussians, rows: impl Iterator<Item = u32>) -> Self {
        let head = &gaussians.color;
        let (mut shares, mut sum) = ([0.0; Color::ALL.len()], 0.0);
        let mut lightnesses = Vec::new();
        for row in rows.map(|row| row as usize) {
            let opacity = 1.0 / (1.0 + (-head.opacity_logits[row]).exp());
            let weight = opacity * area(head.log_scales[row]);
            let Some(&rgb) = head.features[row * head.channels..].first_chunk::<3>() else {
                continue;
            };
            let color = Lab::of_srgb(rgb);
            if !weight.is_finite() || !color.lightness.is_finite() {
                continue;
            }
            for name in names(color) {
                shares[*name as usize] += weight;
            }
            lightnesses.push((color.lightness, weight));
            sum += weight;
        }
        let shares = shares.map(|share| share / f32::max(sum, f32::MIN_POSITIVE));
        Self { shares, lightness: median(lightnesses, sum) }
    }

    /// The share of a color.
    pub(super) fn share(&self, color: Color) -> f32 {
        self.shares[color as usize]
    }

    pub(super) fn is_dark(&self) -> bool {
        self.lightness < DARK
    }

    pub(super) fn is_light(&self) -> bool {
        self.lightness > LIGHT
    }

    /// The color with the largest share, of equals the first.
    pub(super) fn main_color(&self) -> Color {
        let all = Color::ALL.into_iter().rev();
        all.max_by(|a, b| self.share(*a).total_cmp(&self.share(*b))).unwrap_or(Color::Grey)
    }
}

/// For each object whether it has a color.
pub(super) fn having(looks: &[Look], color: Color) -> Vec<bool> {
    let most = looks.iter().map(|look| look.share(color)).fold(0.0, f32::max);
    let least = LEAST_SHARE.max(OF_MOST * most);
    looks.iter().map(|look| look.share(color) >= least).collect()
}

/// Proportional to the area of a Gaussian's disk: the product of the two longer axes.
fn area([x, y, z]: [f32; 3]) -> f32 {
    (x + y + z - x.min(y).min(z)).exp()
}

/// The value below which half of the weight lies; 0 without values.
fn median(mut values: Vec<(f32, f32)>, sum: f32) -> f32 {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut below = 0.0;
    let half = values.iter().find(|(_, weight)| {
        below += weight;
        below >= sum / 2.0
    });
    half.map_or(0.0, |(value, _)| *value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lexsplat_gpu::HostHead;

    fn painted(colors: &[[f32; 3]]) -> HostGaussians {
        let color = HostHead {
            log_scales: vec![[-4.0, -4.0, -6.0]; colors.len()],
            opacity_logits: vec![3.0; colors.len()],
            features: colors.concat(),
            channels: 3,
            ..HostHead::default()
        };
        HostGaussians { color, ..HostGaussians::default() }
    }

    #[test]
    fn an_object_has_the_colors_of_its_surface() {
        let map = painted(&[[0.8, 0.1, 0.1], [0.7, 0.1, 0.1], [0.9, 0.9, 0.9], [0.1, 0.2, 0.7]]);
        let look = |rows: &[u32]| Look::new(&map, rows.iter().copied());
        let (red, spotted, blue) = (look(&[0, 1, 2]), look(&[0, 2, 2, 2, 2]), look(&[3]));
        assert!((red.share(Color::Red) - 2.0 / 3.0).abs() < 1e-6);
        assert_eq!((red.main_color(), blue.main_color()), (Color::Red, Color::Blue));
        let looks = [red, spotted, blue];
        assert_eq!(having(&looks, Color::Red), [true, false, false]);
        assert_eq!(having(&looks, Color::Green), [false; 3]);
        assert!(looks[1].is_light() && looks[2].is_dark());
        let nothing = look(&[]);
        assert!(Color::ALL.iter().all(|color| nothing.share(*color) == 0.0));
    }
}
