//! `lexsplat query` with several texts: labels each pixel or Gaussian with the best of them. Prints
//! the legend; writes labels.png, labels.npy and overlay.png of a view, or points.ply of the whole
//! map.

use crate::files::{make_answer_folder, save, save_image};
use crate::waiting;
use anyhow::{Context as _, Result};
use image::RgbImage;
use lexsplat_client::http::{HttpClient, LegendEntry, Question, ReadOf, Segmentation};
use lexsplat_evaluate::overlay;
use lexsplat_evaluate::table::{Column, table};
use std::path::Path;

/// Weight of the labels' colors in the overlay.
const STRENGTH: f32 = 0.55;

/// A query with several texts, and how the answer is shown.
pub struct Asked<'a> {
    /// The server.
    pub client: &'a HttpClient,
    /// The map.
    pub map: &'a str,
    /// The question, with several texts.
    pub question: &'a Question,
    /// Print the answer as JSON.
    pub json: bool,
}

/// Asks, prints and writes files into `out`.
pub async fn run(asked: &Asked<'_>, out: &Path) -> Result<()> {
    let Asked { client, map, question, json } = asked;
    let found = waiting::shown(client.segment(map, question)).await?;
    let Segmentation { revision, through, settled, converged, .. } = found;
    waiting::note(&ReadOf { revision, through, settled, converged });
    make_answer_folder(out)?;
    match json {
        true => say!("{}", serde_json::to_string_pretty(&found)?)?,
        false => say_part!("{}", described(&found))?,
    }
    if let Some(link) = &found.points {
        save(&out.join("points.ply"), client.points_ply(link).await?)?;
    }
    let frame = question.view.as_ref().and_then(|view| view.frame);
    if let (Some(link), Some(frame)) = (&found.labels, frame) {
        let png = client.labels(link, "image/png").await?;
        save(&out.join("labels.png"), &png)?;
        save(&out.join("labels.npy"), client.labels(link, "application/x-npy").await?)?;
        let render = client.render_png(map, frame).await?;
        let render = image::load_from_memory(&render).context("the server's picture")?.to_rgb8();
        let labels = image::load_from_memory(&png).context("the server's labels")?.to_rgba8();
        save_image(&out.join("overlay.png"), &shown(&render, &labels, &found.legend))?;
    }
    note!("files are in {}", out.display());
    Ok(())
}

/// The image in the labels' colors, with a line for each text above it.
fn shown(picture: &RgbImage, labels: &image::RgbaImage, legend: &[LegendEntry]) -> RgbImage {
    let mut picture = picture.clone();
    let (width, height) = picture.dimensions();
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let column = x * labels.width() / width;
        let row = y * labels.height() / height;
        let [red, green, blue, alpha] = labels.get_pixel(column, row).0;
        let share = STRENGTH * f32::from(alpha) / 255.0;
        for (channel, target) in pixel.0.iter_mut().zip([red, green, blue]) {
            let mixed = f32::from(*channel) * (1.0 - share) + f32::from(target) * share;
            *channel = mixed.round() as u8;
        }
    }
    let seen = legend.iter().filter(|entry| entry.share > 0.0);
    let lines = seen.map(|entry| {
        let swatch = RgbImage::from_pixel(SWATCH, SWATCH, image::Rgb(color(&entry.color)));
        let empty = RgbImage::new(width.saturating_sub(SWATCH), 0);
        overlay::beside(&swatch, &overlay::captioned(&empty, &entry.text))
    });
    overlay::stacked(&lines.chain([picture.clone()]).collect::<Vec<_>>())
}

/// Side of a color sample in the legend, pixels: the height of a caption.
const SWATCH: u32 = 24;

/// `#rrggbb`; black if it is not.
fn color(text: &str) -> [u8; 3] {
    let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6);
    let value = digits.and_then(|digits| u32::from_str_radix(digits, 16).ok()).unwrap_or_default();
    let [_, red, green, blue] = value.to_be_bytes();
    [red, green, blue]
}

fn described(found: &Segmentation) -> String {
    let what = if found.labels.is_some() { "pixels" } else { "Gaussians" };
    let columns = [Column::left("text"), Column::right("label"), Column::right(what)];
    let row = |entry: &LegendEntry| {
        let share = format!("{:.1} %", entry.share * 100.0);
        vec![entry.text.clone(), entry.label.to_string(), share]
    };
    let rows: Vec<Vec<String>> = found.legend.iter().map(row).collect();
    let none = 1.0 - found.legend.iter().map(|entry| entry.share).sum::<f32>();
    format!(
        "{} texts in {}, {:.0} ms\n{}{:.1} % is none of them (relevancy up to {:.2})\n",
        found.texts.len(),
        found.map,
        found.timing_ms.total,
        table(&columns, &rows),
        none.max(0.0) * 100.0,
        found.threshold
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb, Rgba, RgbaImage};

    fn entry(text: &str, share: f32) -> LegendEntry {
        LegendEntry { label: 1, text: text.into(), color: "#ff8000".into(), share }
    }

    #[test]
    fn labels_color_the_picture_and_the_legend_names_them() {
        let picture = RgbImage::from_pixel(80, 10, Rgb([100; 3]));
        let mut labels = RgbaImage::from_pixel(40, 5, Rgba([0, 0, 0, 0]));
        labels.put_pixel(39, 4, Rgba([255, 128, 0, 255]));
        let found = shown(&picture, &labels, &[entry("cup", 0.1), entry("sofa", 0.0)]);
        assert_eq!(found.dimensions(), (80, SWATCH + 10), "only what is there has a line");
        assert_eq!(*found.get_pixel(0, SWATCH), Rgb([100; 3]), "no label, no color");
        assert_eq!(*found.get_pixel(79, SWATCH + 9), Rgb([185, 115, 45]));
        assert_eq!(*found.get_pixel(3, 3), Rgb([255, 128, 0]));
        assert_eq!(color("red"), [0; 3]);
    }
}
