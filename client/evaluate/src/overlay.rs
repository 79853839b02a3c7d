//! Drawing answers on RGB images: relevancy maps, boxes, peaks, captions.

use crate::letters;
use image::{Rgb, RgbImage, imageops};
use lexsplat_client::http::PixelBox;
use lexsplat_client::npy::Array;

/// Relevancies up to this one are not colored: the text fits no better than the negatives.
pub const NEUTRAL: f32 = 0.5;
/// The highest relevancy of a map gets the last color only from this value on, so that weak answers
/// stay pale.
const CLEAR: f32 = 0.6;
/// Weight of the last color in the image.
const STRONGEST: f32 = 0.72;
const BOX_PIXELS: i64 = 2;
const RING_PIXELS: f32 = 6.0;
/// Height of the caption's letters, pixels.
const LETTER: f32 = 16.0;
const BAND: u32 = 24;
/// Space beside a caption, pixels.
const MARGIN: u32 = 8;

const WHITE: Rgb<u8> = Rgb([255, 255, 255]);
const INK: Rgb<u8> = Rgb([20, 22, 28]);

/// The turbo color map: blue, green, yellow, red for 0 to 1.
/// A. Mikhailov's polynomial fit (Google AI blog, 2019).
pub fn turbo(value: f32) -> Rgb<u8> {
    const RED: [f32; 6] =
        [0.135_721_38, 4.615_392_6, -42.660_324, 132.131_08, -152.942_4, 59.286_38];
    const GREEN: [f32; 6] =
        [0.091_402_61, 2.194_188_4, 4.842_966_6, -14.185_033, 4.277_298_6, 2.829_566];
    const BLUE: [f32; 6] = [0.106_673_3, 12.641_946, -60.582_05, 110.362_77, -89.903_11, 27.348_25];
    let x = value.clamp(0.0, 1.0);
    Rgb([RED, GREEN, BLUE].map(|polynomial| {
        let level = polynomial.iter().rev().fold(0.0, |sum, factor| sum * x + factor);
        (level.clamp(0.0, 1.0) * 255.0).round() as u8
    }))
}

/// Colors an image by relevancies `[height, width]`: the higher, the stronger. Pixels without
/// relevancy keep their color. The map is scaled to the image (nearest pixel).
///
/// # Panics
/// If the array does not have two axes of at least one pixel.
pub fn heat(picture: &RgbImage, relevancy: &Array) -> RgbImage {
    let [rows, columns] = relevancy.shape[..] else {
        panic!("relevancy: expected 2 axes, found {:?}", relevancy.shape);
    };
    assert!(rows > 0 && columns > 0, "relevancy: expected pixels, found {rows}x{columns}");
    let greatest = relevancy.values.iter().copied().fold(CLEAR, f32::max);
    let (width, height) = picture.dimensions();
    let mut out = picture.clone();
    for (x, y, pixel) in out.enumerate_pixels_mut() {
        let column = x as usize * columns / width as usize;
        let row = y as usize * rows / height as usize;
        let value = relevancy.values[row * columns + column];
        let strength = ((value - NEUTRAL) / (greatest - NEUTRAL)).clamp(0.0, 1.0);
        // NaN leaves the pixel as it is.
        let share = if strength > 0.0 { STRONGEST * strength.sqrt() } else { 0.0 };
        let color = turbo(strength);
        for (channel, target) in pixel.0.iter_mut().zip(color.0) {
            *channel =
                (f32::from(*channel) * (1.0 - share) + f32::from(target) * share).round() as u8;
        }
    }
    out
}

/// Draws the outline of a box, inside its bounds.
pub fn outline(picture: &mut RgbImage, bounds: &PixelBox, color: Rgb<u8>) {
    let (x0, y0) = (bounds.x.round() as i64, bounds.y.round() as i64);
    let x1 = x0 + bounds.width.round() as i64;
    let y1 = y0 + bounds.height.round() as i64;
    for y in y0..y1 {
        for x in x0..x1 {
            let edge = (x - x0).min(x1 - 1 - x).min(y - y0).min(y1 - 1 - y);
            if edge < BOX_PIXELS {
                put(picture, x, y, color);
            }
        }
    }
}

/// Draws a white ring with a dark rim around a pixel; the pixel itself stays visible.
pub fn ring(picture: &mut RgbImage, x: f32, y: f32) {
    let reach = RING_PIXELS as i64 + 2;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let off = ((dx * dx + dy * dy) as f32).sqrt() - RING_PIXELS;
            if off.abs() <= 1.0 {
                put(picture, x.round() as i64 + dx, y.round() as i64 + dy, WHITE);
            } else if off.abs() <= 2.0 {
                put(picture, x.round() as i64 + dx, y.round() as i64 + dy, INK);
            }
        }
    }
}

/// The image below a caption on a dark band. Captions that are too long are cut.
pub fn captioned(picture: &RgbImage, words: &str) -> RgbImage {
    let mut out = RgbImage::from_pixel(picture.width(), picture.height() + BAND, INK);
    imageops::replace(&mut out, picture, 0, i64::from(BAND));
    let room = out.width().saturating_sub(2 * MARGIN);
    let ends = words.char_indices().map(|(at, letter)| at + letter.len_utf8());
    let fits = ends.take_while(|end| letters::size(&words[..*end], LETTER).0 <= room).last();
    let top = (i64::from(BAND) - i64::from(letters::size("", LETTER).1)) / 2;
    letters::draw(&words[..fits.unwrap_or(0)], LETTER, |x, y, covered| {
        let (x, y) = (i64::from(x) + i64::from(MARGIN), i64::from(y) + top);
        put(&mut out, x, y, mixed(INK, WHITE, covered));
    });
    out
}

/// A color between two others.
fn mixed(from: Rgb<u8>, to: Rgb<u8>, share: f32) -> Rgb<u8> {
    let between = |at: usize| f32::from(from[at]) * (1.0 - share) + f32::from(to[at]) * share;
    Rgb([0, 1, 2].map(|at| between(at).round() as u8))
}

/// Two images side by side; the space below the lower one is dark.
pub fn beside(left: &RgbImage, right: &RgbImage) -> RgbImage {
    let (width, height) = (left.width() + right.width(), left.height().max(right.height()));
    let mut out = RgbImage::from_pixel(width, height, INK);
    imageops::replace(&mut out, left, 0, 0);
    imageops::replace(&mut out, right, i64::from(left.width()), 0);
    out
}

/// Images below each other; the space beside narrower ones is dark.
pub fn stacked(pictures: &[RgbImage]) -> RgbImage {
    let width = pictures.iter().map(RgbImage::width).max().unwrap_or(0);
    let height = pictures.iter().map(RgbImage::height).sum();
    let mut out = RgbImage::from_pixel(width, height, INK);
    let mut top = 0;
    for picture in pictures {
        imageops::replace(&mut out, picture, 0, top);
        top += i64::from(picture.height());
    }
    out
}

fn put(picture: &mut RgbImage, x: i64, y: i64, color: Rgb<u8>) {
    if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
        && let Some(pixel) = picture.get_pixel_mut_checked(x, y)
    {
        *pixel = color;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GREY: Rgb<u8> = Rgb([100, 100, 100]);

    fn grey(width: u32, height: u32) -> RgbImage {
        RgbImage::from_pixel(width, height, GREY)
    }

    fn colored(picture: &RgbImage) -> usize {
        picture.pixels().filter(|pixel| **pixel != GREY).count()
    }

    #[test]
    fn turbo_runs_from_blue_over_green_to_red() {
        let Rgb([r, g, b]) = turbo(0.15);
        assert!(b > r && b > g, "{r} {g} {b}");
        let Rgb([r, g, b]) = turbo(0.5);
        assert!(g > r && g > b, "{r} {g} {b}");
        let Rgb([r, g, b]) = turbo(0.95);
        assert!(r > 2 * g && r > 2 * b, "{r} {g} {b}");
        assert_eq!(turbo(7.0), turbo(1.0));
    }

    #[test]
    fn only_relevant_pixels_are_colored() {
        let relevancy = Array { shape: vec![1, 4], values: vec![0.1, 0.5, f32::NAN, 0.9] };
        let out = heat(&grey(8, 2), &relevancy);
        assert_eq!(colored(&out), 4, "a quarter of the pixels");
        let Rgb([r, g, b]) = *out.get_pixel(7, 1);
        assert!(r > g && r > b, "{r} {g} {b}");
        assert_ne!(*out.get_pixel(7, 1), turbo(1.0), "something of the picture is left");
        let weak = Array { shape: vec![1, 4], values: vec![0.1, 0.2, 0.3, 0.51] };
        let pale = heat(&grey(8, 2), &weak);
        assert!(pale.get_pixel(7, 1).0[0].abs_diff(100) < r.abs_diff(100));
        assert_eq!(colored(&heat(&grey(8, 2), &Array { values: vec![0.5; 4], ..weak })), 0);
    }

    #[test]
    fn outlines_are_two_pixels_and_clipped() {
        let mut picture = grey(20, 20);
        let bounds = PixelBox { x: 5.0, y: 5.0, width: 10.0, height: 8.0, score: 1.0 };
        outline(&mut picture, &bounds, WHITE);
        assert_eq!(colored(&picture), 10 * 8 - 6 * 4);
        assert_eq!(*picture.get_pixel(5, 5), WHITE);
        assert_eq!(*picture.get_pixel(7, 7), GREY);
        assert_eq!(*picture.get_pixel(15, 5), GREY);
        outline(&mut grey(6, 6), &PixelBox { x: -3.0, ..bounds }, WHITE);
    }

    #[test]
    fn the_ring_leaves_its_pixel_and_stays_inside() {
        let mut picture = grey(30, 30);
        ring(&mut picture, 15.0, 15.0);
        assert_eq!(*picture.get_pixel(15, 15), GREY);
        assert_eq!(*picture.get_pixel(21, 15), WHITE);
        ring(&mut grey(4, 4), 0.0, 3.0);
    }

    #[test]
    fn captions_are_written_above_and_cut() {
        let light = |words: &str| {
            let out = captioned(&grey(40, 10), words);
            assert_eq!(out.dimensions(), (40, 10 + BAND));
            assert_eq!(*out.get_pixel(3, BAND), GREY);
            let band = out.enumerate_pixels().filter(|(_, y, _)| *y < BAND);
            band.map(|(.., pixel)| u32::from(pixel[0] - INK[0])).sum::<u32>()
        };
        assert!(light("ab") > light("a"));
        assert_eq!(light("abcdef"), light("abcd"), "there is room for few letters");
        assert_eq!(light(""), 0);
    }

    #[test]
    fn a_sheet_holds_all_images() {
        let sheet = stacked(&[grey(10, 4), beside(&grey(6, 5), &grey(6, 3))]);
        assert_eq!(sheet.dimensions(), (12, 9));
        assert_eq!(*sheet.get_pixel(11, 0), INK);
        assert_eq!(*sheet.get_pixel(11, 6), GREY);
        assert_eq!(*sheet.get_pixel(11, 8), INK);
    }
}
