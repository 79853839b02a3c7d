//! The most important numbers of a report, beside the paper's. The paper's number is given only
//! where both measure the same quantity; its data set is always another one.

use super::paper::PAPER;
use super::record::{Refined, Report};
use crate::language::{LabelMeans, Language};
use crate::presence::Presence;
use crate::space::Space;
use crate::uncertainty::Uncertainty;
use crate::views::ViewMeans;

/// A row of the overview: a number beside the paper's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Row {
    /// The quantity, with its unit.
    pub what: &'static str,
    /// The value, formatted.
    pub value: String,
    /// The paper's value; empty if it has none.
    pub paper: String,
}

/// The rows of a report, in order.
pub fn rows(report: &Report) -> Vec<Row> {
    let mut rows = speed_rows(report);
    rows.extend(map_rows(report));
    rows.extend(view_rows(&HELD_OUT, &report.held_out));
    rows.extend(view_rows(&KEYFRAMES, &report.keyframe_views));
    rows.extend(report.language.iter().flat_map(language_rows));
    rows.extend(report.space.iter().flat_map(space_rows));
    rows.extend(report.presence.iter().flat_map(presence_rows));
    rows.extend(report.uncertainty.iter().flat_map(uncertainty_rows));
    rows
}

/// A row that the paper has no number for.
fn plain(what: &'static str, value: String) -> Row {
    Row { what, value, paper: String::new() }
}

fn speed_rows(report: &Report) -> Vec<Row> {
    let [least, most] = PAPER.seconds_per_frame;
    vec![
        plain("frames acknowledged per second", format!("{:.2}", report.fps)),
        plain("seconds per frame acknowledged", format!("{:.3}", report.seconds_per_frame)),
        Row {
            what: "seconds per frame, all work done",
            value: format!("{:.3}", report.seconds_per_frame_settled),
            paper: format!("{least} to {most} (one GPU, tracking too)"),
        },
        plain(
            "  on the probe's reference machine",
            decimals(report.scaled.as_ref().map(|scaled| scaled.seconds_per_frame_settled), 3),
        ),
        plain(
            "processor time of the server per frame, s",
            decimals(report.processor_seconds_per_frame, 3),
        ),
        plain("settling after the last frame, s", format!("{:.1}", report.settle_seconds)),
    ]
    .into_iter()
    .chain(report.refined.iter().flat_map(refinement_rows))
    .collect()
}

fn refinement_rows(refined: &Refined) -> [Row; 2] {
    [
        plain("refinement after settling, s", format!("{:.1}", refined.seconds)),
        plain("  processor time of the server, s", decimals(refined.processor_seconds, 1)),
    ]
}

fn map_rows(report: &Report) -> Vec<Row> {
    let Report { frames_tracked, frames_lost, frames_refused, .. } = report;
    let frames = format!("{frames_tracked} / {frames_lost} / {frames_refused}");
    vec![
        plain("frames tracked / lost / refused", frames),
        plain("keyframes", report.keyframes.to_string()),
        plain("Gaussians", report.gaussians.to_string()),
        plain("device memory of the Gaussians, MiB", mebibytes(Some(report.gpu_bytes))),
        plain("memory of the keyframes, MiB", mebibytes(Some(report.keyframe_bytes))),
        plain("peak memory of the server, MiB", mebibytes(report.peak_rss_bytes)),
        Row {
            what: "ATE RMSE, cm",
            value: ate(report),
            paper: format!("{} (tracked)", PAPER.ate_rmse_cm),
        },
    ]
}

/// Names of the rows of one kind of views.
struct ViewNames {
    psnr: &'static str,
    ssim: &'static str,
    lpips: &'static str,
    depth: &'static str,
    /// Whether the paper's numbers are of this kind.
    is_papers: bool,
}

const HELD_OUT: ViewNames = ViewNames {
    psnr: "PSNR held out, dB",
    ssim: "SSIM held out",
    lpips: "LPIPS held out",
    depth: "depth L1 held out, m",
    is_papers: true,
};
const KEYFRAMES: ViewNames = ViewNames {
    psnr: "PSNR keyframes, dB",
    ssim: "SSIM keyframes",
    lpips: "LPIPS keyframes",
    depth: "depth L1 keyframes, m",
    is_papers: false,
};

fn view_rows(names: &ViewNames, means: &ViewMeans) -> Vec<Row> {
    let row = |what, value, paper: f64| {
        let paper = if names.is_papers { paper.to_string() } else { String::new() };
        Row { what, value, paper }
    };
    let mut rows = vec![
        row(names.psnr, decimals(means.psnr_db, 2), PAPER.psnr_db),
        row(names.ssim, decimals(means.ssim, 4), PAPER.ssim),
    ];
    if means.lpips.is_some() {
        rows.push(row(names.lpips, decimals(means.lpips, 4), PAPER.lpips));
    }
    rows.push(plain(names.depth, decimals(means.depth_l1_m, 4)));
    rows
}

fn language_rows(language: &Language) -> Vec<Row> {
    let LabelMeans { loc_box, loc_synonyms, masks } = language.scene;
    let row = |what, value: f64, paper: &str| Row {
        what,
        value: format!("{value:.3}"),
        paper: paper.to_owned(),
    };
    let mut rows = Vec::new();
    if let Some(masks) = &masks {
        rows.extend([
            row("mIoU at 0.5 (as in the paper)", masks.miou_paper, &PAPER.miou.to_string()),
            row("  filter of 20 pixels at any size", masks.miou_unscaled, ""),
            row("mIoU at the bundle's threshold", masks.miou_bundle, ""),
            row("mIoU as the released script has it", masks.miou_released, ""),
            row("mIoU closed set (argmax)", masks.miou_argmax, ""),
        ]);
    }
    rows.push(row("Loc, peak in a box", loc_box, &PAPER.loc_accuracy.to_string()));
    rows.extend(loc_synonyms.map(|share| row("  asked by synonyms", share, "")));
    if let Some(masks) = &masks {
        rows.extend([
            row("Loc, peak on the thing", masks.loc_mask, ""),
            row("average precision, no threshold", masks.average_precision, ""),
            row("  of a map that knows nothing", masks.share, ""),
        ]);
    }
    rows.extend([
        row("a question about a view, median ms", language.latency.p50_ms, ""),
        row("  99 of 100 within, ms", language.latency.p99_ms, ""),
    ]);
    rows
}

/// The paper's values are over 8 Replica scenes, at its own scale of relevancy; its EMD pairs
/// clouds of unequal sizes.
fn space_rows(space: &Space) -> Vec<Row> {
    let means = &space.means;
    let row =
        |what, value: Option<f64>, paper: String| Row { what, value: decimals(value, 3), paper };
    let mut rows = vec![
        row("3D Chamfer over labels, m", means.chamfer_m, String::new()),
        row(
            "  without failures",
            means.chamfer_without_failures_m,
            format!("{} (10 failures)", PAPER.chamfer_m),
        ),
        row("3D EMD over labels, m", means.emd_m, String::new()),
        row(
            "  without failures (EMD)",
            means.emd_without_failures_m,
            format!("{} (14 failures, unequal clouds)", PAPER.emd_m),
        ),
        Row {
            what: "labels without a 3D answer / Chamfer failures / EMD failures",
            value: format!(
                "{} / {} / {}",
                means.unanswered, means.chamfer_failures, means.emd_failures
            ),
            paper: String::new(),
        },
        row("classes counted within one", space.counted_within_one, String::new()),
    ];
    let most = space.counts.iter().filter(|count| count.there > 1).max_by_key(|count| count.there);
    rows.extend(most.map(|count| Row {
        what: "things of the most frequent class, counted / there",
        value: format!("{}: {} / {}", count.class, count.found, count.there),
        paper: String::new(),
    }));
    rows
}

fn presence_rows(presence: &Presence) -> Vec<Row> {
    let row =
        |what, value: Option<f64>| Row { what, value: decimals(value, 3), paper: String::new() };
    vec![
        row("present said rightly", presence.present_accuracy),
        row("absent said rightly", presence.absent_accuracy),
        row("  present in a view", presence.view_present_accuracy),
        row("  absent from a view", presence.view_absent_accuracy),
        row("calibration error of confidence", Some(presence.reliability.ece)),
        row(
            "  of the logistic that fits these answers",
            presence.fitted.as_ref().map(|fitted| fitted.reliability.ece),
        ),
    ]
}

fn uncertainty_rows(found: &Uncertainty) -> Vec<Row> {
    let row = |what, value: f64| plain(what, format!("{value:.3}"));
    vec![
        row("pixels of answers about views that are wrong", found.wrong),
        row("  the least certain tenth", found.wrong_least_certain),
        row("  the others", found.wrong_rest),
        row("calibration error of uncertainty", found.calibration_error),
    ]
}

fn ate(report: &Report) -> String {
    match (report.ate, report.poses) {
        (None, _) => "no true poses".into(),
        (Some(ate), "given") => format!("{:.3} (poses were given)", ate.rmse_cm),
        (Some(ate), _) => format!("{:.3}", ate.rmse_cm),
    }
}

fn mebibytes(bytes: Option<u64>) -> String {
    bytes.map_or_else(|| "not reported".into(), |bytes| format!("{:.0}", bytes as f64 / 1048576.0))
}

fn decimals(value: Option<f64>, count: usize) -> String {
    value.map_or_else(|| "–".into(), |value| format!("{value:.count$}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::example::example_report;

    #[test]
    fn rows_keep_held_out_and_keyframes_apart_and_name_the_paper() {
        let found = rows(&example_report());
        let row = |what: &str| found.iter().find(|row| row.what == what).unwrap();
        assert_eq!(row("PSNR held out, dB").value, "22.00");
        assert_eq!(row("PSNR held out, dB").paper, "35.81");
        assert_eq!(row("PSNR keyframes, dB").value, "24.00");
        assert_eq!(row("PSNR keyframes, dB").paper, "");
        assert!(row("ATE RMSE, cm").value.contains("given"));
        // A frame is acknowledged before its work is done: the paper is beside the honest number.
        assert_eq!(row("seconds per frame acknowledged").paper, "");
        assert!(row("seconds per frame, all work done").value == "0.275");
        assert_eq!(row("  on the probe's reference machine").value, "0.138");
        assert_eq!(row("processor time of the server per frame, s").value, "0.500");
        assert_eq!(row("mIoU at 0.5 (as in the paper)").paper, "0.487");
        let chamfer = row("3D Chamfer over labels, m");
        assert_eq!((chamfer.value.as_str(), chamfer.paper.as_str()), ("0.120", ""));
        assert!(row("  without failures").paper.starts_with("0.736"));
        assert_eq!(row("present said rightly").value, "1.000");
        let without = Report { language: None, psnr_db: None, ..example_report() };
        assert!(!rows(&without).iter().any(|row| row.what.contains("mIoU")));
    }
}
