//! A drawing backend for plotters: an RGB image.

use crate::letters;
use image::{Rgb, RgbImage};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendTextStyle, DrawingBackend, DrawingErrorKind,
};
use std::convert::Infallible;

/// An image to draw on.
pub(super) struct Canvas<'a>(pub &'a mut RgbImage);

type Done = Result<(), DrawingErrorKind<Infallible>>;

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
        let (pixels, color, turn) = (style.size() as f32, style.color(), style.transform());
        let (width, height) = letters::size(text, pixels);
        let (width, height) = (width as i32, height as i32);
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
        letters::draw(text, pixels, |x, y, covered| {
            let (x, y) = turn.transform(x + dx, y + dy);
            let alpha = color.alpha * f64::from(covered);
            // Drawing on an image in memory does not fail.
            let _ = self.draw_pixel((left + x, top + y), BackendColor { alpha, ..color });
        });
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        Ok(letters::size(text, style.size() as f32))
    }
}
