//! Names of colors.
//!
//! A color is called what the nearest of some examples is called. Distances are between saturation and hue,
//! (a / L, b / L) of Oklab (Ottosson 2020), and lightness L, which counts little: light of half the strength
//! multiplies L, a and b by the same factor, so that a / L and b / L are the same in shadow. Where people
//! disagree, an example has two names.

use crate::pipeline::query::question::Color;

/// How much a difference in lightness counts.
const LIGHTNESS: f32 = 0.35;
/// Added to L: a dark color has no clear hue.
const DARK: f32 = 0.05;

/// A color in Oklab.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lab {
    /// 0 (black) to 1 (white).
    pub lightness: f32,
    a: f32,
    b: f32,
}

use Color::{
    Beige, Black, Blue, Brown, Green, Grey, Orange, Pink, Purple, Red, Turquoise, White, Yellow,
};

/// Examples, sRGB, with all names that fit.
const EXAMPLES: &[(u32, &[Color])] = &[
    (0xff0000, &[Red]),
    (0xc83228, &[Red]),
    (0x8b0000, &[Red]),
    (0xb02030, &[Red]),
    (0x6b1a1a, &[Red, Brown]),
    (0xc0584c, &[Red]),
    (0xa04030, &[Red, Brown]),
    (0xff8c00, &[Orange]),
    (0xe07828, &[Orange]),
    (0xf0a050, &[Orange]),
    (0xff7040, &[Orange, Red]),
    (0xffa000, &[Orange, Yellow]),
    (0xffff00, &[Yellow]),
    (0xf0d000, &[Yellow]),
    (0xe8b41e, &[Yellow]),
    (0xf0e060, &[Yellow]),
    (0xb09020, &[Yellow, Brown]),
    (0x00a000, &[Green]),
    (0x2e8c50, &[Green]),
    (0x006400, &[Green]),
    (0x80c040, &[Green]),
    (0x90d090, &[Green]),
    (0x556b2f, &[Green]),
    (0x708060, &[Green, Grey]),
    (0x8aa828, &[Green]),
    (0x00ffff, &[Turquoise, Blue]),
    (0x40d0d0, &[Turquoise]),
    (0x1e96a0, &[Turquoise, Blue]),
    (0x008080, &[Turquoise, Green]),
    (0x80c8c8, &[Turquoise]),
    (0x0000ff, &[Blue]),
    (0x2864b4, &[Blue]),
    (0x283c64, &[Blue]),
    (0x87ceeb, &[Blue]),
    (0x4682b4, &[Blue]),
    (0x6080a0, &[Blue, Grey]),
    (0x000080, &[Blue]),
    (0x800080, &[Purple]),
    (0x7a3c96, &[Purple]),
    (0x9060d0, &[Purple]),
    (0xb090d0, &[Purple]),
    (0x6a5a7c, &[Purple, Grey]),
    (0xff69b4, &[Pink]),
    (0xffc0cb, &[Pink]),
    (0xd65a8c, &[Pink]),
    (0xff00ff, &[Pink, Purple]),
    (0xe0a0a8, &[Pink]),
    (0xc07080, &[Pink]),
    (0x8b4513, &[Brown]),
    (0x5c3a24, &[Brown]),
    (0xa0622d, &[Brown]),
    (0x3a2010, &[Brown, Black]),
    (0xb08050, &[Brown]),
    (0xc8975a, &[Brown, Beige]),
    (0x806850, &[Brown]),
    (0xd2b48c, &[Beige, Brown]),
    (0xe8d8b8, &[Beige]),
    (0xf5f0dc, &[Beige, White]),
    (0xffffff, &[White]),
    (0xf0f0f0, &[White]),
    (0xe0e0e0, &[White, Grey]),
    (0xf0ebe0, &[White, Beige]),
    (0xe8f0f8, &[White]),
    (0xb0b0b0, &[Grey]),
    (0x808080, &[Grey]),
    (0x505050, &[Grey]),
    (0x707880, &[Grey]),
    (0xa8a098, &[Grey, Beige]),
    (0x383838, &[Black, Grey]),
    (0x202020, &[Black]),
    (0x000000, &[Black]),
];

/// The names of a color, sRGB in 0..1, best first.
pub(super) fn names(color: Lab) -> &'static [Color] {
    let difference = |example: Lab| {
        let [u, v] = color.saturation().map(f32::from);
        let [p, q] = example.saturation();
        let light = LIGHTNESS * (color.lightness - example.lightness);
        (u - p).powi(2) + (v - q).powi(2) + light * light
    };
    let priced = EXAMPLES.iter().map(|(rgb, names)| (difference(of_hex(*rgb)), *names));
    priced.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(&[], |(_, names)| names)
}

impl Lab {
    /// Of sRGB, 0..1; values outside are clamped.
    pub(super) fn of_srgb(rgb: [f32; 3]) -> Self {
        let [r, g, b] = rgb.map(|value| linear(value.clamp(0.0, 1.0)));
        let l = (0.412_221_5 * r + 0.536_332_5 * g + 0.051_445_99 * b).cbrt();
        let m = (0.211_903_5 * r + 0.680_699_5 * g + 0.107_396_96 * b).cbrt();
        let s = (0.088_302_46 * r + 0.281_718_8 * g + 0.629_978_7 * b).cbrt();
        Self {
            lightness: 0.210_454_26 * l + 0.793_617_8 * m - 0.004_072_047 * s,
            a: 1.977_998_5 * l - 2.428_592_2 * m + 0.450_593_7 * s,
            b: 0.025_904_037 * l + 0.782_771_77 * m - 0.808_675_77 * s,
        }
    }

    fn saturation(self) -> [f32; 2] {
        [self.a, self.b].map(|part| part / (self.lightness + DARK))
    }
}

fn of_hex(rgb: u32) -> Lab {
    Lab::of_srgb([rgb >> 16, rgb >> 8, rgb].map(|byte| (byte & 0xff) as f32 / 255.0))
}

fn linear(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn oklab_has_its_published_values() {
        let close = |found: Lab, [lightness, a, b]: [f32; 3]| {
            assert!((found.lightness - lightness).abs() < 1e-3, "{found:?}");
            assert!((found.a - a).abs() < 1e-3 && (found.b - b).abs() < 1e-3, "{found:?}");
        };
        close(of_hex(0xffffff), [1.0, 0.0, 0.0]);
        close(of_hex(0xff0000), [0.628, 0.225, 0.126]);
        close(of_hex(0x0000ff), [0.452, -0.032, -0.312]);
    }

    #[test]
    fn colors_keep_their_name_in_shadow() {
        for (rgb, name) in [
            ([0.9, 0.1, 0.1], Red),
            ([0.15, 0.35, 0.75], Blue),
            ([0.2, 0.6, 0.3], Green),
            ([0.9, 0.8, 0.1], Yellow),
            ([0.5, 0.25, 0.6], Purple),
        ] {
            for share in [1.0, 0.5, 0.25] {
                // Half of the light: half of the linear values.
                let dim = |value: f32| (linear(value) * share).powf(1.0 / 2.2);
                let found = names(Lab::of_srgb(rgb.map(dim)));
                assert!(found.contains(&name), "{name:?} at {share}: {found:?}");
            }
        }
        // Negative control: a gray has no such name, however bright.
        for value in [0.1, 0.4, 0.7, 1.0] {
            let found = names(Lab::of_srgb([value; 3]));
            assert!(found.iter().all(|name| [Black, Grey, White].contains(name)), "{found:?}");
        }
    }

    #[test]
    fn all_colors_have_examples() {
        for color in Color::ALL {
            assert!(EXAMPLES.iter().any(|(_, names)| names[0] == color), "{color:?}");
        }
    }
}
