//! Letters on pictures: DejaVu Sans, which is compiled in, so that no font is needed.

use ab_glyph::{Font as _, FontRef, PxScale, ScaleFont as _, point};
use std::sync::LazyLock;

static FONT: LazyLock<FontRef<'static>> = LazyLock::new(|| {
    FontRef::try_from_slice(dejavu::sans::regular()).expect("the crate's font is whole")
});

/// Width and height of a line of text, in pixels, for a font of so many pixels from the lowest to the highest
/// letter.
pub(crate) fn size(text: &str, pixels: f32) -> (u32, u32) {
    let font = FONT.as_scaled(PxScale::from(pixels));
    let width: f32 = text.chars().map(|letter| font.h_advance(font.glyph_id(letter))).sum();
    (width.ceil() as u32, font.height().ceil() as u32)
}

/// Calls `ink` with column and row of each pixel of a line of text and how much of it is covered, 0 to 1.
/// Letters that the font lacks are boxes.
pub(crate) fn draw(text: &str, pixels: f32, mut ink: impl FnMut(i32, i32, f32)) {
    let font = FONT.as_scaled(PxScale::from(pixels));
    let mut left = 0.0;
    for letter in text.chars() {
        let id = font.glyph_id(letter);
        let glyph = id.with_scale_and_position(pixels, point(left, font.ascent()));
        left += font.h_advance(id);
        let Some(outline) = font.outline_glyph(glyph) else { continue };
        let corner = outline.px_bounds().min;
        outline.draw(|x, y, covered| {
            ink(x as i32 + corner.x as i32, y as i32 + corner.y as i32, covered.min(1.0));
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_are_drawn_inside_their_line() {
        let mut covered = 0.0;
        let (width, height) = size("Ågé 0.5 m", 16.0);
        draw("Ågé 0.5 m", 16.0, |x, y, share| {
            assert!(
                (-1..=width as i32).contains(&x) && (0..=height as i32).contains(&y),
                "{x} {y}"
            );
            assert!((0.0..=1.0).contains(&share));
            covered += share;
        });
        assert!(covered > 50.0, "{covered}");
        draw("  ", 16.0, |_, _, share| assert!(share == 0.0, "a space has no ink"));
        assert!(size("mm", 16.0).0 > size("ii", 16.0).0, "letters have widths of their own");
        assert_eq!(size("", 16.0).0, 0);
    }
}
