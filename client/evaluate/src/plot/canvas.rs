//! A drawing backend for plotters: an RGB image, with an 8x8 bitmap font instead of a font file.

use font8x8::{BASIC_FONTS, UnicodeFonts as _};
use image::{Rgb, RgbImage};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendTextStyle, DrawingBackend, DrawingErrorKind,
};
use std::convert::Infallible;

/// Side of the font's letters, pixels.
const LETTER: i32 = 8;

/// An image to draw on.
pub(super) struct Canvas<'a>(pub &'a mut RgbImage);

type Done = Result<(), DrawingErrorKind<Infallible>>;

/// Enlargement of the letters for a font size in pixels.
fn enlarged(size: f64) -> i32 {
    (size / f64::from(LETTER)).round().max(1.0) as i32
}

impl DrawingBackend for Canvas<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        self.0.dimensions()
    }

    fn ensure_prepared(&mut self) -> Done {
        Ok(())
    }

    fn present(&mut self) -> Done {
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, color: BackendColor) -> Done {
        if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
            && let Some(Rgb(pixel)) = self.0.get_pixel_mut_checked(x, y)
        {
            let (r, g, b) = color.rgb;
            for (channel, new) in pixel.iter_mut().zip([r, g, b]) {
                let mixed =
                    f64::from(*channel) * (1.0 - color.alpha) + f64::from(new) * color.alpha;
                *channel = mixed.round() as u8;
            }
        }
        Ok(())
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        (left, top): BackendCoord,
    ) -> Done {
        let (scale, color, turn) = (enlarged(style.size()), style.color(), style.transform());
        let (width, height) = (text.chars().count() as i32 * LETTER * scale, LETTER * scale);
        let dx = match style.anchor().h_pos {
            HPos::Left => 0,
            HPos::Right => -width,
            HPos::Center => -width / 2,
        };
        let dy = match style.anchor().v_pos {
            VPos::Top => 0,
            VPos::Center => -height / 2,
            VPos::Bottom => -height,
        };
        for (at, letter) in text.chars().enumerate() {
            // Letters that the font lacks are blank.
            let glyph = BASIC_FONTS.get(letter).unwrap_or_default();
            for y in 0..height {
                for x in 0..LETTER * scale {
                    if glyph[(y / scale) as usize] >> (x / scale) & 1 == 1 {
                        let along = at as i32 * LETTER * scale + x;
                        let (x, y) = turn.transform(along + dx, y + dy);
                        self.draw_pixel((left + x, top + y), color)?;
                    }
                }
            }
        }
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let side = (LETTER * enlarged(style.size())) as u32;
        Ok((text.chars().count() as u32 * side, side))
    }
}
