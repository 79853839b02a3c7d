//! The results of the demo: a table of answers, and a folder with an image and a heat map for each
//! question, a contact sheet and a page.

use super::ask::Asked;
use crate::answer::{BOX, MOST_BOXES, best_object, metres, shown};
use crate::files::{save, save_image};
use anyhow::{Context as _, Result};
use image::codecs::jpeg::JpegEncoder;
use image::imageops::{self, FilterType};
use image::{ExtendedColorType, ImageEncoder as _, RgbImage};
use lexsplat_evaluate::overlay;
use lexsplat_evaluate::table::{Column, table};
use std::path::Path;

/// Larger images are scaled down to this width, pixels.
const PICTURE_COLUMNS: u32 = 480;
const JPEG_QUALITY: u8 = 88;

/// A table of all answers.
pub fn answers_table(asked: &[Asked]) -> String {
    let columns = [
        Column::left("question"),
        Column::right("frame"),
        Column::left("present"),
        Column::right("confidence"),
        Column::right("peak px"),
        Column::right("score"),
        Column::left("hit"),
        Column::left("3D centre m"),
        Column::left("hit"),
        Column::right("ms"),
    ];
    table(&columns, &asked.iter().map(row).collect::<Vec<_>>())
}

fn row(one: &Asked) -> Vec<String> {
    let dash = || "-".to_owned();
    let peak = one.seen.peak;
    let object = best_object(&one.space);
    vec![
        one.text.clone(),
        one.view.sequence.to_string(),
        if one.seen.present { "yes" } else { "no" }.into(),
        format!("{:.2}", one.seen.confidence),
        peak.map_or_else(dash, |peak| format!("{:.0}, {:.0}", peak.x, peak.y)),
        peak.map_or_else(dash, |peak| format!("{:.2}", peak.score)),
        one.verdict.map_or_else(dash, |verdict| mark(verdict.peak_inside).into()),
        object.map_or_else(dash, |object| metres(object.center)),
        one.verdict.map_or_else(dash, |verdict| mark(verdict.center_inside).into()),
        format!("{:.0}", one.milliseconds),
    ]
}

fn mark(right: bool) -> &'static str {
    if right { "✓" } else { "✗" }
}

/// A line with the number of right answers; `None` if ground truth has none of the classes.
pub fn verdicts(asked: &[Asked]) -> Option<String> {
    let judged: Vec<_> = asked.iter().filter_map(|one| one.verdict).collect();
    let peaks = judged.iter().filter(|verdict| verdict.peak_inside).count();
    let centers = judged.iter().filter(|verdict| verdict.center_inside).count();
    let all = judged.len();
    (all > 0).then(|| {
        format!(
            "{peaks} of {all} peaks are inside the right object; \
             {centers} of {all} 3D centres are inside its box"
        )
    })
}

/// An image of an answer: the frame with boxes beside the rendered view with the heat map.
pub fn picture(one: &Asked, frame: &RgbImage, render: &RgbImage) -> RgbImage {
    let mut left = frame.clone();
    for bounds in one.seen.boxes.iter().flatten().take(MOST_BOXES) {
        overlay::outline(&mut left, bounds, BOX);
    }
    if let Some(peak) = one.seen.peak {
        overlay::ring(&mut left, peak.x, peak.y);
    }
    let right = shown(render, &one.relevancy, &one.seen);
    overlay::captioned(&overlay::beside(&small(left), &small(right)), &caption(one))
}

fn small(picture: RgbImage) -> RgbImage {
    let (width, height) = picture.dimensions();
    if width <= PICTURE_COLUMNS {
        return picture;
    }
    let rows = (height * PICTURE_COLUMNS / width).max(1);
    imageops::resize(&picture, PICTURE_COLUMNS, rows, FilterType::Triangle)
}

fn caption(one: &Asked) -> String {
    let score = one.seen.peak.map_or(0.0, |peak| peak.score);
    let hit = match one.verdict {
        Some(verdict) if verdict.peak_inside => ": hit",
        Some(_) => ": miss",
        None => "",
    };
    format!("{}, frame {}, {score:.2}{hit}", one.text, one.view.sequence)
}

/// A file name: lower-case letters and digits, with dashes between words.
pub fn slug(text: &str) -> String {
    let simple = |c: char| if c.is_alphanumeric() { c.to_ascii_lowercase() } else { ' ' };
    let words: String = text.chars().map(simple).collect();
    let words: Vec<&str> = words.split_whitespace().collect();
    if words.is_empty() { "question".into() } else { words.join("-") }
}

/// Writes `QUESTION.png`, `QUESTION.npy`, `demo.jpg` and `report.md`.
///
/// # Errors
/// If a file cannot be written.
pub fn write(out: &Path, asked: &[Asked], pictures: &[RgbImage], heading: &str) -> Result<()> {
    let mut page = format!("# {heading}\n\n```text\n{}```\n", answers_table(asked));
    if let Some(line) = verdicts(asked) {
        page += &format!("\n{line}.\n");
    }
    page += "\nLeft: the frame with boxes; right: the map's own view with the relevancy. \
             The ring is the peak.\n";
    for (one, picture) in asked.iter().zip(pictures) {
        let name = slug(&one.text);
        save_image(&out.join(format!("{name}.png")), picture)?;
        save(&out.join(format!("{name}.npy")), &one.npy)?;
        page += &format!("\n## {}\n![{}]({name}.png)\n", one.text, one.text);
    }
    let sheet = overlay::stacked(pictures);
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY)
        .write_image(&sheet, sheet.width(), sheet.height(), ExtendedColorType::Rgb8)
        .context("cannot encode demo.jpg")?;
    save(&out.join("demo.jpg"), &jpeg)?;
    save(&out.join("report.md"), page)
}

#[cfg(test)]
mod tests {
    use super::super::ask::{Verdict, View};
    use super::*;
    use lexsplat_client::npy::Array;
    use serde_json::json;

    fn asked(verdict: Option<Verdict>) -> Asked {
        let answer = json!({"query_id": "q", "text": "t", "map": "m", "revision": 1, "present": true,
            "confidence": 0.9, "coverage": 1.0, "threshold": 0.5,
            "boxes": [{"x": 1, "y": 1, "width": 8, "height": 6, "score": 0.9}],
            "peak": {"x": 20, "y": 10, "score": 0.91},
            "objects": [{"score": 0.8, "center_metres": [1.0, -2.0, 0.5], "size_metres": [1, 1, 1],
                "rotation": [1, 0, 0, 0], "aabb_min_metres": [0, 0, 0], "aabb_max_metres": [1, 1, 1], "points": 9}],
            "timing_ms": {"text": 1, "render": 1, "decode": 1, "score": 1, "total": 4}});
        let answer: lexsplat_client::http::Answer = serde_json::from_value(answer).unwrap();
        Asked {
            text: "potted plant".into(),
            view: View { index: 3, sequence: 33 },
            relevancy: Array { shape: vec![1, 2], values: vec![0.1, 0.9] },
            npy: b"npy".to_vec(),
            seen: answer.clone(),
            space: answer,
            milliseconds: 41.6,
            verdict,
        }
    }

    const RIGHT: Verdict = Verdict { peak_inside: true, center_inside: true };
    const WRONG: Verdict = Verdict { peak_inside: false, center_inside: true };

    #[test]
    fn the_table_has_a_row_for_each_question() {
        let text = answers_table(&[asked(Some(RIGHT)), asked(Some(WRONG)), asked(None)]);
        let rows: Vec<&str> = text.lines().collect();
        assert_eq!(rows.len(), 4);
        for part in
            ["potted plant", "33", "yes", "0.90", "20, 10", "0.91", "1.00  -2.00   0.50", "42"]
        {
            assert!(rows[1].contains(part), "{part:?} in {}", rows[1]);
        }
        assert_eq!(rows[1].matches('✓').count(), 2);
        assert_eq!((rows[2].matches('✓').count(), rows[2].matches('✗').count()), (1, 1));
        assert!(!rows[3].contains(['✓', '✗']));
    }

    #[test]
    fn right_answers_are_counted_among_the_judged_ones() {
        let line = verdicts(&[asked(Some(RIGHT)), asked(Some(WRONG)), asked(None)]).unwrap();
        assert!(line.starts_with("1 of 2 peaks are inside the right object"), "{line}");
        assert_eq!(verdicts(&[asked(None)]), None);
    }

    #[test]
    fn images_are_side_by_side_and_large_ones_are_scaled_down() {
        let one = asked(None);
        let frame = RgbImage::new(40, 30);
        let out = picture(&one, &frame, &frame);
        assert_eq!(out.width(), 80);
        assert!(out.height() > 30);
        let left = out.view_of(0, 40);
        assert_ne!(left, RgbImage::new(left.width(), left.height()), "boxes are drawn");
        let large = RgbImage::new(960, 600);
        assert_eq!(picture(&one, &large, &large).width(), 2 * PICTURE_COLUMNS);
    }

    trait ViewOf {
        fn view_of(&self, left: u32, width: u32) -> RgbImage;
    }

    impl ViewOf for RgbImage {
        fn view_of(&self, left: u32, width: u32) -> RgbImage {
            imageops::crop_imm(self, left, 24, width, self.height() - 24).to_image()
        }
    }

    #[test]
    fn files_have_plain_names() {
        assert_eq!(slug("Potted plant"), "potted-plant");
        assert_eq!(slug("../etc/passwd"), "etc-passwd");
        assert_eq!(slug("?"), "question");
    }

    #[test]
    fn the_folder_is_complete() {
        let folder = std::env::temp_dir().join(format!("lexsplat-report-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let one = asked(Some(RIGHT));
        let shown = picture(&one, &RgbImage::new(40, 30), &RgbImage::new(40, 30));
        write(&folder, &[one], &[shown], "room7").unwrap();
        for name in ["potted-plant.png", "potted-plant.npy", "demo.jpg", "report.md"] {
            assert!(folder.join(name).is_file(), "{name}");
        }
        let page = std::fs::read_to_string(folder.join("report.md")).unwrap();
        assert!(page.contains("1 of 1 peaks") && page.contains("(potted-plant.png)"), "{page}");
        assert!(write(&folder.join("missing"), &[], &[], "room7").is_err());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
