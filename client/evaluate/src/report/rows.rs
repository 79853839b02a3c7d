//! The numbers of a report to look at first, beside the paper's. In: a [`Report`]. Out: [`Row`]s. A
//! paper's number stands only where both mean the same; of another data set it is in any case.

use super::paper::PAPER;
use super::record::Report;
use crate::language::Language;
use crate::presence::Presence;
use crate::space::Space;

/// A number for people, beside the paper's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Row {
    /// What was measured.
    pub what: &'static str,
    /// With its unit.
    pub value: String,
    /// The paper's, or nothing.
    pub paper: String,
}

/// The rows of a report, in order.
pub fn rows(report: &Report) -> Vec<Row> {
    let row = |what, value, paper| Row { what, value, paper };
    let none = String::new;
    let [least, most] = PAPER.seconds_per_frame;
    let mut rows = vec![
        row("frames acknowledged per second", format!("{:.2}", report.fps), none()),
        row("seconds per frame acknowledged", format!("{:.3}", report.seconds_per_frame), none()),
        row(
            "seconds per frame, all work done",
            format!("{:.3}", report.seconds_per_frame_settled),
            format!("{least} to {most} (one GPU, tracking too)"),
        ),
        row("settling after the last frame, s", format!("{:.1}", report.settle_seconds), none()),
        row(
            "frames tracked / lost / refused",
            format!(
                "{} / {} / {}",
                report.frames_tracked, report.frames_lost, report.frames_refused
            ),
            none(),
        ),
        row("keyframes", report.keyframes.to_string(), none()),
        row("Gaussians", report.gaussians.to_string(), none()),
        row("device memory of the Gaussians, MiB", mebibytes(Some(report.gpu_bytes)), none()),
        row("memory of the keyframes, MiB", mebibytes(Some(report.keyframe_bytes)), none()),
        row("peak memory of the server, MiB", mebibytes(report.peak_rss_bytes), none()),
        row("ATE RMSE, cm", ate(report), format!("{} (tracked)", PAPER.ate_rmse_cm)),
    ];
    let views = [("held out", &report.held_out), ("keyframes", &report.keyframe_views)];
    for (kind, means) in views {
        let held_out = kind == "held out";
        let paper = |value: f64| if held_out { value.to_string() } else { String::new() };
        let name = |a, b| if held_out { a } else { b };
        rows.extend([
            row(
                name("PSNR held out, dB", "PSNR keyframes, dB"),
                decimals(means.psnr_db, 2),
                paper(PAPER.psnr_db),
            ),
            row(
                name("SSIM held out", "SSIM keyframes"),
                decimals(means.ssim, 4),
                paper(PAPER.ssim),
            ),
        ]);
        if let Some(lpips) = means.lpips {
            rows.push(row(
                name("LPIPS held out", "LPIPS keyframes"),
                decimals(Some(lpips), 4),
                paper(PAPER.lpips),
            ));
        }
        rows.extend([row(
            name("depth L1 held out, m", "depth L1 keyframes, m"),
            decimals(means.depth_l1_m, 4),
            none(),
        )]);
    }
    rows.extend(report.language.iter().flat_map(language_rows));
    rows.extend(report.space.iter().flat_map(space_rows));
    rows.extend(report.presence.iter().flat_map(presence_rows));
    rows
}

fn language_rows(language: &Language) -> Vec<Row> {
    let scene = &language.scene;
    let row = |what, value: f64, paper: &str| Row {
        what,
        value: format!("{value:.3}"),
        paper: paper.to_owned(),
    };
    let paper_miou = PAPER.miou.to_string();
    vec![
        row("mIoU at 0.5 (as in the paper)", scene.miou_paper, &paper_miou),
        row("  filter of 20 pixels at any size", scene.miou_unscaled, ""),
        row("mIoU at the bundle's threshold", scene.miou_bundle, ""),
        row("mIoU as the released script has it", scene.miou_released, ""),
        row("mIoU closed set (argmax)", scene.miou_argmax, ""),
        row("Loc, peak in a box", scene.loc_box, &PAPER.loc_accuracy.to_string()),
        row("Loc, peak on the thing", scene.loc_mask, ""),
        row("average precision, no threshold", scene.average_precision, ""),
        row("  of a map that knows nothing", scene.share, ""),
        row("a question about a view, median ms", language.latency.p50_ms, ""),
        row("  99 of 100 within, ms", language.latency.p99_ms, ""),
    ]
}

/// The paper's are over 8 Replica scenes, at its own scale of relevancy; its EMD pairs clouds of
/// unequal sizes.
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
        assert_eq!(row("mIoU at 0.5 (as in the paper)").paper, "0.487");
        let chamfer = row("3D Chamfer over labels, m");
        assert_eq!((chamfer.value.as_str(), chamfer.paper.as_str()), ("0.120", ""));
        assert!(row("  without failures").paper.starts_with("0.736"));
        assert_eq!(row("present said rightly").value, "1.000");
        let without = Report { language: None, psnr_db: None, ..example_report() };
        assert!(!rows(&without).iter().any(|row| row.what.contains("mIoU")));
    }
}
