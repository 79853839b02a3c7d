//! Plots of an evaluation, as RGB images of [`SIZE`] pixels.

mod canvas;

use crate::presence::{Bin, Presence};
use crate::stages::{Stage, WITH_WAITING};
use crate::trajectory::{StampedPose, align};
use crate::uncertainty::Uncertainty;
use crate::views::ViewScore;
use canvas::Canvas;
use image::RgbImage;
use nalgebra::{Unit, Vector3};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use std::collections::BTreeMap;
use std::convert::Infallible;
use std::ops::Range;

/// Columns and rows.
pub const SIZE: (u32, u32) = (1200, 700);
const FONT: (&str, i32) = ("sans-serif", 16);
/// Space around a plot, left of it for numbers, below it and above it for the title, pixels.
const MARGIN: u32 = 20;
const LEFT: u32 = 110;
const BELOW: u32 = 60;
const ABOVE: u32 = 40;
const TRUTH: RGBColor = RGBColor(120, 120, 120);
const FOUND: RGBColor = RGBColor(200, 60, 40);
const KEYFRAME: RGBColor = RGBColor(40, 90, 200);

/// Least share on logarithmic axes; smaller ones are drawn there.
const LEAST_SHARE: f64 = 1e-5;

type Error = DrawingAreaErrorKind<Infallible>;
type Chart<'a, 'b> = ChartContext<'a, Canvas<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// The aligned estimate and the truth from above; `None` for less than two frames. Up is the mean
/// direction of the cameras' upper edges.
pub fn trajectory(pairs: &[[StampedPose; 2]]) -> Option<RgbImage> {
    if pairs.len() < 2 {
        return None;
    }
    let truth_from_estimate = align(pairs);
    let aligned: Vec<[Vector3<f64>; 2]> = pairs
        .iter()
        .map(|[estimate, truth]| {
            let estimate = truth_from_estimate * estimate.world_from_camera;
            [estimate.translation.vector, truth.world_from_camera.translation.vector]
        })
        .collect();
    let [right, ahead] = ground(pairs);
    let flat = |p: &Vector3<f64>| (p.dot(&right), p.dot(&ahead));
    let lines: Vec<[(f64, f64); 2]> =
        aligned.iter().map(|[estimate, truth]| [flat(estimate), flat(truth)]).collect();
    let [x, y] = equal_scales(lines.iter().flatten());
    Some(drawn("trajectory from above, metres (grey: truth, red: estimate)", x, y, |chart| {
        let mut mesh = chart.configure_mesh();
        mesh.label_style(FONT).light_line_style(WHITE).x_desc("m").y_desc("m").draw()?;
        let side = |at: usize| lines.iter().map(move |pair| pair[at]);
        chart.draw_series(LineSeries::new(side(1), TRUTH.stroke_width(5)))?;
        chart.draw_series(LineSeries::new(side(0), FOUND.stroke_width(2)))?;
        chart.draw_series(side(0).take(1).map(|at| Circle::new(at, 6, FOUND.filled())))?;
        Ok(())
    }))
}

/// Two directions of the ground plane: right and ahead, seen from above.
fn ground(pairs: &[[StampedPose; 2]]) -> [Vector3<f64>; 2] {
    let up = |[_, truth]: &[StampedPose; 2]| truth.world_from_camera.rotation * -Vector3::y();
    let mean: Vector3<f64> = pairs.iter().map(up).sum();
    let up = Unit::try_new(mean, 1e-9).unwrap_or_else(Vector3::z_axis);
    // The world axis that is closest to the ground plane points to the right.
    let axis = [Vector3::x(), Vector3::y(), Vector3::z()]
        .into_iter()
        .min_by(|a, b| a.dot(&up).abs().total_cmp(&b.dot(&up).abs()))
        .expect("there are three");
    let right = (axis - up.scale(axis.dot(&up))).normalize();
    [right, up.cross(&right)]
}

/// Ranges that contain all points, with equal scale on both axes.
fn equal_scales<'a>(points: impl Iterator<Item = &'a (f64, f64)> + Clone) -> [Range<f64>; 2] {
    let (width, height) =
        (f64::from(SIZE.0 - LEFT - 2 * MARGIN), f64::from(SIZE.1 - BELOW - ABOVE - 2 * MARGIN));
    let x = extent(points.clone().map(|point| point.0));
    let y = extent(points.map(|point| point.1));
    let per_pixel = ((x.end - x.start) / width).max((y.end - y.start) / height) * 1.1;
    let around = |range: Range<f64>, pixels: f64| {
        let (middle, half) = ((range.start + range.end) / 2.0, per_pixel * pixels / 2.0);
        middle - half..middle + half
    };
    [around(x, width), around(y, height)]
}

/// The range of finite values, never empty.
fn extent(values: impl Iterator<Item = f64>) -> Range<f64> {
    let finite = values.filter(|value| value.is_finite());
    let (low, high) = finite.fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
    if low > high {
        return 0.0..1.0;
    }
    let half = (high - low).max(1e-3) / 2.0;
    let middle = (low + high) / 2.0;
    middle - half..middle + half
}

/// PSNR of the rendered views over frame numbers; `None` if there are none.
pub fn psnr(views: &[ViewScore]) -> Option<RgbImage> {
    let points = |keyframe: bool| -> Vec<(f64, f64)> {
        let own = views.iter().filter(|view| view.keyframe == keyframe && view.psnr_db.is_finite());
        own.map(|view| (view.sequence as f64, view.psnr_db)).collect()
    };
    let (held_out, keyframes) = (points(false), points(true));
    let all = || held_out.iter().chain(&keyframes);
    all().next()?;
    let x = extent(all().map(|point| point.0));
    let y = extent(all().map(|point| point.1));
    let (x, y) = (x.start - 1.0..x.end + 1.0, (y.start - 1.0).floor()..(y.end + 1.0).ceil());
    Some(drawn("PSNR, dB, by frame (red: held out, blue: keyframes)", x, y, |chart| {
        let whole = |value: &f64| format!("{value:.0}");
        let mut mesh = chart.configure_mesh();
        mesh.label_style(FONT)
            .light_line_style(WHITE)
            .x_label_formatter(&whole)
            .x_desc("frame")
            .y_desc("dB")
            .draw()?;
        chart.draw_series(LineSeries::new(held_out.iter().copied(), FOUND.stroke_width(2)))?;
        let dot = |color: RGBColor| move |at: &(f64, f64)| Circle::new(*at, 4, color.filled());
        chart.draw_series(held_out.iter().map(dot(FOUND)))?;
        chart.draw_series(keyframes.iter().map(dot(KEYFRAME)))?;
        Ok(())
    }))
}

/// Milliseconds per frame of each stage, as bars; `None` if there are no stages. The time of a
/// frame with its wait in the queue is left out: it would dwarf the others.
pub fn stages(stages: &BTreeMap<String, Stage>, frames: u64) -> Option<RgbImage> {
    let per_frame = |stage: &Stage| stage.seconds * 1e3 / frames.max(1) as f64;
    let worked = stages.iter().rev().filter(|(name, _)| *name != WITH_WAITING);
    let bars: Vec<(&str, f64)> =
        worked.map(|(name, stage)| (name.as_str(), per_frame(stage))).collect();
    let longest = bars.iter().map(|bar| bar.1).fold(0.0, f64::max);
    if bars.is_empty() {
        return None;
    }
    let (x, y) = (0.0..longest.max(1e-3) * 1.3, 0.0..bars.len() as f64);
    Some(drawn("stages, ms per frame (they run beside each other)", x, y, |chart| {
        let mut mesh = chart.configure_mesh();
        mesh.label_style(FONT)
            .light_line_style(WHITE)
            .disable_y_mesh()
            .y_labels(0)
            .x_desc("ms per frame")
            .draw()?;
        let inside = |at: usize| at as f64 + 0.25..at as f64 + 0.75;
        chart.draw_series(bars.iter().enumerate().map(|(at, (_, length))| {
            let Range { start, end } = inside(at);
            Rectangle::new([(0.0, start), (*length, end)], KEYFRAME.filled())
        }))?;
        chart.draw_series(bars.iter().enumerate().map(|(at, (name, length))| {
            Text::new(format!(" {name} {length:.1}"), (*length, at as f64 + 0.55), FONT)
        }))?;
        Ok(())
    }))
}

/// The reliability diagram: share of objects that are there over confidence, a dot for each bin
/// (larger for more answers), in blue after the fit. On the grey line the calibration is perfect.
/// `None` without answers.
pub fn reliability(presence: &Presence) -> Option<RgbImage> {
    let bins = &presence.reliability.bins;
    if bins.is_empty() {
        return None;
    }
    let title = format!(
        "confidence and truth: error {:.3} (red){}",
        presence.reliability.ece,
        presence.fitted.as_ref().map_or(String::new(), |fitted| format!(
            ", fitted {:.3} (blue)",
            fitted.reliability.ece
        ))
    );
    Some(drawn(&title, -0.05..1.05, -0.05..1.05, |chart| {
        let mut mesh = chart.configure_mesh();
        mesh.label_style(FONT)
            .light_line_style(WHITE)
            .x_desc("confidence")
            .y_desc("share there")
            .draw()?;
        chart.draw_series(LineSeries::new([(0.0, 0.0), (1.0, 1.0)], TRUTH.stroke_width(2)))?;
        let fitted = presence.fitted.as_ref().map(|fitted| (&fitted.reliability.bins, KEYFRAME));
        for (bins, color) in fitted.into_iter().chain([(bins, FOUND)]) {
            let at = |bin: &Bin| (bin.confidence, bin.there);
            chart.draw_series(LineSeries::new(bins.iter().map(at), color.stroke_width(2)))?;
            chart.draw_series(bins.iter().map(|bin| {
                Circle::new(at(bin), 3 + (bin.count as f64).sqrt() as i32, color.filled())
            }))?;
        }
        Ok(())
    }))
}

/// Share of the pixels that are wrong over uncertainty, a dot for each tenth of the pixels; both axes are
/// logarithmic. On the grey line the uncertainties are probabilities.
pub fn uncertainty(found: &Uncertainty) -> RgbImage {
    let title = format!(
        "wrong pixels: {:.3} of the least certain tenth, {:.4} of the others",
        found.wrong_least_certain, found.wrong_rest
    );
    let decades = |share: f64| share.max(LEAST_SHARE).log10();
    let range = || LEAST_SHARE.log10() - 0.2..0.2;
    let points =
        || found.tenths.iter().map(|part| (decades(part.uncertainty), decades(part.wrong)));
    drawn(&title, range(), range(), |chart| {
        let share = |decades: &f64| {
            format!("{:.5}", 10_f64.powf(*decades))
                .trim_end_matches('0')
                .trim_end_matches('.')
                .to_owned()
        };
        let mut mesh = chart.configure_mesh();
        mesh.label_style(FONT)
            .light_line_style(WHITE)
            .x_labels(6)
            .y_labels(6)
            .x_label_formatter(&share)
            .y_label_formatter(&share)
            .x_desc("uncertainty")
            .y_desc("share wrong")
            .draw()?;
        let ends = [LEAST_SHARE.log10(), 0.0].map(|end| (end, end));
        chart.draw_series(LineSeries::new(ends, TRUTH.stroke_width(2)))?;
        chart.draw_series(LineSeries::new(points(), FOUND.stroke_width(2)))?;
        chart.draw_series(points().map(|at| Circle::new(at, 6, FOUND.filled())))?;
        Ok(())
    })
}

/// A chart with a title on a white background.
fn drawn(
    title: &str,
    x: Range<f64>,
    y: Range<f64>,
    draw: impl FnOnce(&mut Chart<'_, '_>) -> Result<(), Error>,
) -> RgbImage {
    let mut picture = RgbImage::new(SIZE.0, SIZE.1);
    let result = (|| {
        let area = Canvas(&mut picture).into_drawing_area();
        area.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(&area)
            .caption(title, FONT)
            .margin(MARGIN)
            .x_label_area_size(BELOW)
            .y_label_area_size(LEFT)
            .build_cartesian_2d(x, y)?;
        draw(&mut chart)
    })();
    // Drawing into memory does not fail.
    result.expect("a picture in memory takes every pixel");
    picture
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::presence::Judgement;
    use crate::uncertainty::Part;
    use nalgebra::Isometry3;

    fn count(picture: &RgbImage, RGBColor(r, g, b): RGBColor) -> usize {
        picture.pixels().filter(|pixel| pixel.0 == [r, g, b]).count()
    }

    fn walk(offset: f64) -> Vec<[StampedPose; 2]> {
        let pose = |i: u64, off: f64| {
            let at = Vector3::new(
                (i as f64 * 0.2).cos() + off * (i as f64).sin(),
                0.0,
                (i as f64 * 0.2).sin(),
            );
            StampedPose { nanos: i, world_from_camera: Isometry3::new(at, Vector3::zeros()) }
        };
        (0..30).map(|i| [pose(i, offset), pose(i, 0.0)]).collect()
    }

    #[test]
    fn equal_trajectories_coincide_and_others_do_not() {
        let good = trajectory(&walk(0.0)).unwrap();
        assert_eq!(good.dimensions(), SIZE);
        assert!(count(&good, FOUND) > 500 && count(&good, TRUTH) > 500);
        let bad = trajectory(&walk(0.3)).unwrap();
        assert!(count(&bad, FOUND) > count(&good, FOUND) + 500, "a longer way");
        assert!(trajectory(&walk(0.0)[..1]).is_none());
    }

    #[test]
    fn the_ground_is_level_and_right_handed_from_above() {
        let [right, ahead] = ground(&walk(0.0));
        // These cameras have y down: up is -y.
        assert!(right.y.abs() < 1e-12 && ahead.y.abs() < 1e-12 && right.dot(&ahead).abs() < 1e-12);
        assert!((right.cross(&ahead) + Vector3::y()).norm() < 1e-9);
    }

    #[test]
    fn frames_and_stages_are_drawn() {
        let view = |sequence, keyframe, psnr_db| ViewScore {
            sequence,
            keyframe,
            psnr_db,
            ssim: 1.0,
            lpips: None,
            depth_l1_m: None,
            depth_share: None,
        };
        let views = [view(1, false, 20.0), view(3, true, 25.0), view(9, true, f64::INFINITY)];
        let picture = psnr(&views).unwrap();
        assert!(count(&picture, FOUND) > 20 && count(&picture, KEYFRAME) > 20);
        assert_eq!(count(&psnr(&views[..1]).unwrap(), KEYFRAME), 0);
        assert!(psnr(&[]).is_none());
        let stage = |seconds| Stage { count: 1, seconds, mean_ms: 0.0 };
        let both = [("a".to_owned(), stage(1.0)), ("b".to_owned(), stage(2.0))].into();
        let one = [("b".to_owned(), stage(2.0)), (WITH_WAITING.to_owned(), stage(9.0))].into();
        let bars = |of: &BTreeMap<String, Stage>| count(&stages(of, 10).unwrap(), KEYFRAME);
        assert!(bars(&both) > 1000 && 10 * bars(&one) > 12 * bars(&both), "waiting is no bar");
        assert!(stages(&BTreeMap::new(), 10).is_none());
    }

    #[test]
    fn confidences_are_drawn_with_their_fit() {
        let judgement = |i: usize, there: bool| Judgement {
            text: "sofa".into(),
            frame: None,
            there,
            present: there,
            confidence: i as f32 / 20.0,
        };
        let both: Vec<_> = (0..20).map(|i| judgement(i, i % 7 + i > 14)).collect();
        let all_there = both.iter().map(|one| Judgement { there: true, ..one.clone() }).collect();
        let drawn = |judgements| reliability(&Presence::of(judgements, &[]));
        let picture = drawn(both).unwrap();
        assert!(count(&picture, FOUND) > 200 && count(&picture, KEYFRAME) > 200);
        assert_eq!(count(&drawn(all_there).unwrap(), KEYFRAME), 0, "nothing to fit");
        assert!(drawn(Vec::new()).is_none());
    }

    #[test]
    fn tenths_are_drawn() {
        let part = |uncertainty, wrong| Part { uncertainty, wrong };
        let found = |tenths: Vec<Part>| Uncertainty {
            pixels: 100,
            wrong: 0.1,
            wrong_least_certain: 0.4,
            wrong_rest: 0.05,
            calibration_error: 0.1,
            tenths,
        };
        let picture = uncertainty(&found(vec![part(0.5, 0.4), part(0.1, 0.05), part(0.0, 0.0)]));
        assert!(count(&picture, FOUND) > 500 && count(&picture, TRUTH) > 500);
        assert_eq!(count(&uncertainty(&found(vec![])), FOUND), 0);
    }

    #[test]
    fn text_is_drawn() {
        let ink = |title: &str| {
            let picture = drawn(title, 0.0..1.0, 0.0..1.0, |_| Ok(()));
            picture.pixels().filter(|pixel| pixel.0[0] < 128).count()
        };
        assert!(ink("PSNR") > ink(" ") + 30, "{} and {}", ink("PSNR"), ink(" "));
    }
}
