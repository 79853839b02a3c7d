//! Parts of answers as text and in images.

use image::{Rgb, RgbImage};
use lexsplat_client::http::{Answer, Object};
use lexsplat_client::npy::Array;
use lexsplat_evaluate::overlay;

/// Color of boxes in images.
pub const BOX: Rgb<u8> = Rgb([255, 214, 10]);
/// Boxes drawn in an image; more would hide it.
pub const MOST_BOXES: usize = 3;
/// The answer's best object, if it has one.
pub fn best_object(answer: &Answer) -> Option<&Object> {
    answer.objects.as_deref().and_then(|objects| objects.first())
}

/// An image with the heat map, the best boxes and the peak of an answer.
pub fn shown(image: &RgbImage, relevancy: &Array, answer: &Answer) -> RgbImage {
    let mut image = overlay::heat(image, relevancy);
    for bounds in answer.boxes.iter().flatten().take(MOST_BOXES) {
        overlay::outline(&mut image, bounds, BOX);
    }
    if let Some(peak) = &answer.peak {
        overlay::ring(&mut image, peak.x, peak.y);
    }
    image
}

/// Three lengths in columns of equal width.
pub fn metres(lengths: [f32; 3]) -> String {
    lengths.map(|length| format!("{length:6.2}")).join(" ")
}
