//! A few images to look at: target, render and heat map of the best class in its best frame and of
//! the worst class in its worst frame; target and render of the best and the worst held-out view.

use crate::context::{Context, Relevancy};
use crate::error::EvaluateError;
use crate::labels::smoothing;
use crate::language::{LabelScore, Language, MaskScore};
use crate::overlay;
use crate::recorded::Seen;
use crate::views::ViewScore;
use image::RgbImage;
use lexsplat_client::npy::Array;

/// An image with a name.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Stem of a file name, such as `best-class`.
    pub name: String,
    /// What the image shows.
    pub caption: String,
    /// Images side by side.
    pub picture: RgbImage,
}

/// Best or worst.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rank {
    Best,
    Worst,
}

impl Rank {
    const BOTH: [Self; 2] = [Self::Best, Self::Worst];

    fn name(self) -> &'static str {
        match self {
            Self::Best => "best",
            Self::Worst => "worst",
        }
    }

    /// The best or worst item by a value; the first of equals.
    fn of<T>(self, items: &[T], value: impl Fn(&T) -> f64) -> Option<&T> {
        let sign = if self == Self::Best { -1.0 } else { 1.0 };
        items.iter().min_by(|a, b| (sign * value(a)).total_cmp(&(sign * value(b))))
    }
}

/// Fetches the images.
pub(crate) async fn take(
    context: &Context<'_>,
    views: &[ViewScore],
    language: Option<&Language>,
    seen: &[Seen],
) -> Result<Vec<Sample>, EvaluateError> {
    let mut samples = Vec::new();
    let held_out: Vec<&ViewScore> = views.iter().filter(|view| !view.keyframe).collect();
    for rank in Rank::BOTH {
        let Some(view) = rank.of(&held_out, |view| view.psnr_db) else { continue };
        let (target, render) = pair(context, view.sequence, seen).await?;
        let words = format!("frame {}: target, render {:.1} dB", view.sequence, view.psnr_db);
        samples.push(sample(format!("{}-view", rank.name()), words, &[target, render]));
    }
    let Some(language) = language else { return Ok(samples) };
    for rank in Rank::BOTH {
        let Some(class) = rank.of(&language.classes, |class| class.means.quality()) else {
            continue;
        };
        let own: Vec<&LabelScore> =
            language.scores.iter().filter(|score| score.label == class.label).collect();
        let Some(score) = rank.of(&own, |score| score.quality()) else { continue };
        let (target, render) = pair(context, score.sequence, seen).await?;
        let Relevancy { heatmap, .. } = context.relevancy(&class.query, score.sequence).await?;
        let smooth = heatmap.smoothed(smoothing(heatmap.width));
        let shape = vec![smooth.values.len() / smooth.width, smooth.width];
        let mut heat = overlay::heat(&render, &Array { shape, values: smooth.values.clone() });
        if let Some((x, y)) = smooth.peak() {
            overlay::ring(&mut heat, x as f32, y as f32);
        }
        let words = format!(
            "{} in frame {}: target, render, relevancy; {}",
            class.label,
            score.sequence,
            in_words(score, language.bundle_threshold)
        );
        samples.push(sample(format!("{}-class", rank.name()), words, &[target, render, heat]));
    }
    Ok(samples)
}

/// The score of a label in a frame.
fn in_words(score: &LabelScore, threshold: f32) -> String {
    match &score.on_mask {
        Some(MaskScore { average_precision, iou_paper, iou_bundle, .. }) => format!(
            "AP {average_precision:.2}, IoU {iou_paper:.2} at 0.5, {iou_bundle:.2} at {threshold:.2}"
        ),
        None if score.peak_in_box => "the peak lies in a box".into(),
        None => "the peak lies in no box".into(),
    }
}

async fn pair(
    context: &Context<'_>,
    sequence: u64,
    seen: &[Seen],
) -> Result<(RgbImage, RgbImage), EvaluateError> {
    let found = seen.iter().find(|seen| seen.sequence == sequence);
    let index = found.expect("only frames that were read are scored").index;
    let target = context.dataset.clean_frame(index)?.rgb(&context.dataset.intrinsics())?;
    Ok((target, context.render(sequence).await?))
}

fn sample(name: String, caption: String, pictures: &[RgbImage]) -> Sample {
    let mut row = pictures[0].clone();
    for picture in &pictures[1..] {
        row = overlay::beside(&row, picture);
    }
    let picture = overlay::captioned(&row, &caption);
    Sample { name, caption, picture }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn best_and_worst_are_the_first_of_equals() {
        let values = [0.5, 0.9, 0.1, 0.9];
        assert_eq!(Rank::Best.of(&[], |v: &f64| *v), None);
        assert!(std::ptr::eq(Rank::Best.of(&values, |v| *v).unwrap(), &values[1]));
        assert!(std::ptr::eq(Rank::Worst.of(&values, |v| *v).unwrap(), &values[2]));
    }

    #[test]
    fn samples_are_images_in_a_row_below_a_caption() {
        let one = RgbImage::new(30, 20);
        let sample = sample("best".into(), "words".into(), &[one.clone(), one.clone(), one]);
        assert_eq!(sample.picture.width(), 90);
        assert!(sample.picture.height() > 20);
    }
}
