//! The report as a page of Markdown: numbers beside the paper's, classes, stages, how it was measured,
//! the server's settings. In: a [`Report`]. Out: text; pictures are only referred to.

use super::record::Report;
use super::rows::rows;
use crate::labels::{COUNTED_EVERY, LABELS, LEAST_PIXELS, SMOOTHING, TEST_FRAMES, smoothing};
use crate::language::{ClassScore, Language};
use crate::presence::{ABSENT_NOUNS, Presence, Reliability, VIEWS};
use crate::space::{CountScore, PAIRED, SEEN_PIXELS, Space, VOXEL_METRES};
use crate::views::HELD_OUT_EVERY;
use std::fmt::Write as _;

/// The report as Markdown; `pictures` are the names and captions of files beside it.
pub fn markdown(report: &Report, pictures: &[(String, String)]) -> String {
    let [width, height] = report.frame_size;
    let mut page = format!(
        "# {}: {} frames of {width}x{height}, poses {}, {}\n\nlexsplat {} on {}; networks: {}.\n\n",
        report.dataset,
        report.frames,
        match report.poses {
            "given" => "given",
            _ => "estimated by the server",
        },
        match report.encoder {
            "oracle" => "language given: the true classes' names (oracle)",
            _ => "language by the server's networks",
        },
        report.version,
        report.adapter,
        report.bundle
    );
    page += "| what | here | the paper (another data set: 8 Replica scenes, tracked poses) |\n|---|---|---|\n";
    for row in rows(report) {
        line(&mut page, format_args!("| {} | {} | {} |", row.what, row.value, row.paper));
    }
    if let Some(ate) = &report.ate {
        line(
            &mut page,
            format_args!(
                "\nATE over {} of {} tracked frames: RMSE {:.3} cm, mean {:.3}, median {:.3}, \
                 greatest {:.3}.",
                ate.frames,
                report.frames_tracked,
                ate.rmse_cm,
                ate.mean_cm,
                ate.median_cm,
                ate.max_cm
            ),
        );
    }
    if let Some(language) = &report.language {
        page += &classes(language);
    }
    page += &report.space.as_ref().map(space).unwrap_or_default();
    page += &report.presence.as_ref().map(presence).unwrap_or_default();
    page += &stages(report);
    page += &protocol(report);
    page += "\n## Pictures\n\n";
    for (file, caption) in pictures {
        line(&mut page, format_args!("![{caption}]({file})\n\n*{caption}*\n"));
    }
    page += "## Settings of the server\n\n";
    match &report.config {
        Some(config) => line(&mut page, format_args!("```toml\n{}\n```", config.trim_end())),
        None => page += "Not known: the server was not started by this evaluation.\n",
    }
    page
}

fn line(page: &mut String, text: std::fmt::Arguments<'_>) {
    writeln!(page, "{text}").expect("writing to a string does not fail");
}

fn classes(language: &Language) -> String {
    let mut page = format!(
        "\n## Words\n\nThe {} classes with most pixels, asked by name in {} frames; {} questions, \
         half within {:.0} ms, 99 of 100 within {:.0} ms.\n\n| class | frames | share | IoU at 0.5 | IoU at {:.2} | IoU released | \
         IoU argmax | Loc box | Loc thing | AP |\n|---|---|---|---|---|---|---|---|---|---|\n",
        language.classes.len(),
        language.test_frames.len(),
        language.latency.questions,
        language.latency.p50_ms,
        language.latency.p99_ms,
        language.bundle_threshold
    );
    let row = |page: &mut String, ClassScore { label, frames, means: m }: &ClassScore| {
        line(
            page,
            format_args!(
                "| {label} | {frames} | {:.3} | {:.3} | {:.3} | {:.3} | {:.3} | {:.2} | {:.2} | \
                 {:.3} |",
                m.share,
                m.miou_paper,
                m.miou_bundle,
                m.miou_released,
                m.miou_argmax,
                m.loc_box,
                m.loc_mask,
                m.average_precision
            ),
        );
    };
    language.classes.iter().for_each(|class| row(&mut page, class));
    let frames = language.test_frames.len();
    row(
        &mut page,
        &ClassScore { label: "**mean over frames**".into(), frames, means: language.scene },
    );
    page
}

/// The paper's Chamfer and EMD in Replica's room0 (its table of 3D localisation), by label.
const PAPER_ROOM0: [(&str, f64, f64); 7] = [
    ("cabinet", 0.04, 0.05),
    ("cushion", 0.55, 0.03),
    ("stool", 0.20, 0.40),
    ("rug", 0.26, 1.49),
    ("lamp", 1.22, 4.08),
    ("wall", 0.09, 0.05),
    ("ceiling", 0.27, 0.71),
];

fn space(space: &Space) -> String {
    let mut page = format!(
        "\n## In space\n\nThe same classes asked of the whole map, points above {:.2}. Metres.\n\n\
         | class | points | voxels | Chamfer | found to truth | truth to found | EMD | the paper's \
         Chamfer, EMD (its room0, the class of that name) |\n|---|---|---|---|---|---|---|---|\n",
        space.threshold
    );
    let metres =
        |value: Option<f64>| value.map_or_else(|| "–".into(), |value| format!("{value:.3}"));
    for one in &space.labels {
        let paper = PAPER_ROOM0.iter().find(|(label, ..)| *label == one.label);
        line(
            &mut page,
            format_args!(
                "| {} | {} | {} | {} | {} | {} | {} | {} |",
                one.label,
                one.points,
                one.truth_voxels,
                metres(one.chamfer_m),
                metres(one.found_to_truth_m),
                metres(one.truth_to_found_m),
                metres(one.emd_m),
                paper.map(|(_, cd, emd)| format!("{cd}, {emd}")).unwrap_or_default()
            ),
        );
    }
    page += "\nThings of a class, as objects in the answer and as the frames show them:\n\n\
             | class | counted | there |\n|---|---|---|\n";
    for CountScore { class, there, found } in &space.counts {
        line(&mut page, format_args!("| {class} | {found} | {there} |"));
    }
    page
}

fn presence(presence: &Presence) -> String {
    let Reliability { ece, brier, bins } = &presence.reliability;
    let mut page = format!(
        "\n## Is it there\n\n{} answers. Calibration error of `confidence` {ece:.3}, Brier score \
         {brier:.3}.\n\n| answers | mean confidence | share there |\n|---|---|---|\n",
        presence.judgements.len()
    );
    for bin in bins {
        line(
            &mut page,
            format_args!("| {} | {:.3} | {:.3} |", bin.count, bin.confidence, bin.there),
        );
    }
    if let Some(fitted) = &presence.fitted {
        line(
            &mut page,
            format_args!(
                "\nWhat would fit these answers best: the logit of `confidence` times {:.3} plus {:.3} \
                 (a bundle with `confidence_steepness` s and `present_threshold` p would take s times \
                 the one, and p less the other over that), with a calibration error of {:.3} and a \
                 Brier score of {:.3} on the answers that it was fitted to.",
                fitted.scale, fitted.offset, fitted.reliability.ece, fitted.reliability.brier
            ),
        );
    }
    let wrong: Vec<String> = presence
        .judgements
        .iter()
        .filter(|one| one.frame.is_none() && one.present != one.there)
        .map(|one| {
            let verdict = if one.there { "not found" } else { "said to be there" };
            format!("{} ({verdict}, {:.2})", one.text, one.confidence)
        })
        .collect();
    if !wrong.is_empty() {
        line(&mut page, format_args!("\nWrong about the whole map: {}.", wrong.join(", ")));
    }
    page
}

fn stages(report: &Report) -> String {
    let mut page = String::from(
        "\n## Stages\n\nWhat the server reports, from the opening of the stream until the map was \
         settled. Stages run beside each other, and `frame` holds the time in the queue: they do \
         not add up to the time of a frame.\n\n| stage | runs | mean, ms | ms per frame |\n\
         |---|---|---|---|\n",
    );
    for (name, stage) in &report.stages {
        let per_frame = stage.seconds * 1e3 / report.frames.max(1) as f64;
        line(
            &mut page,
            format_args!("| {name} | {} | {:.1} | {per_frame:.1} |", stage.count, stage.mean_ms),
        );
    }
    page
}

/// How it was measured, so that two reports mean the same.
fn protocol(report: &Report) -> String {
    let mut page = format!(
        "\n## How it was measured\n\n\
         - **Speed**: *acknowledged* is from the opening of the stream to the last \
         acknowledgement, reading (or rendering) the data set included: a frame is acknowledged when \
         it is tracked, its optimisation and language may still wait. *All work done* adds the time \
         until the map had settled, language included.\n\
         - **ATE**: all tracked frames, rigid alignment (Umeyama, no scale), distances of \
         positions; lost frames do not count and are given apart. The paper counts keyframes only.\n\
         - **Held out**: {} ({}), rendered at the tracked pose. The same walk, so near to \
         keyframes: not a new path. Keyframes ({}) are what the map was optimised on.\n\
         - **PSNR, SSIM**: RGB of 8 bits as 0..1, all pixels, mean over frames; SSIM with an 11x11 \
         Gaussian window (sigma 1.5), border left out. The paper leaves black pixels out of PSNR \
         and pads SSIM with zeros.\n\
         - **Depth L1**: pixels with measured and rendered depth{}.\n",
        match report.hold_out_every {
            Some(every) => format!("every {every}th frame was tracked and never a keyframe"),
            None => format!("every {HELD_OUT_EVERY}th of the tracked frames that are no keyframe"),
        },
        report.held_out.views,
        report.keyframe_views.views,
        match report.held_out.depth_share {
            Some(share) => format!(" ({:.1} % of the measured ones, held out)", share * 100.0),
            None => String::new(),
        }
    );
    if report.language.is_some() {
        let side = smoothing(report.frame_size[0] as usize);
        page += &format!(
            "- **Words**: the {LABELS} classes with most pixels over every {COUNTED_EVERY}th tracked \
             frame, walls, floor and ceiling included; at most {TEST_FRAMES} frames, evenly spaced \
             over the tracked frames that are no keyframe (the paper: 21 at random, or 16 by list). \
             A label counts where it has {LEAST_PIXELS} pixels. The relevancy map at frame size is \
             smoothed by a mean of {SMOOTHING} pixels in 1200 columns, as in the paper ({side} here). *IoU at 0.5*: the paper's threshold; its \
             relevancies are of another feature space, whose 0.5 means something else. *IoU \
             released*: the map and its 30-pixel mean averaged, scaled to 0..1 over the frame, above \
             0.75, 7x7 majority. *Argmax*: each pixel is the label with the greatest relevancy. *Loc \
             box*: the peak lies in a box around a connected region of the label; *Loc thing*: on \
             the label itself. *AP*: average precision over pixels, no threshold; `share` is what a \
             map that knows nothing gets. A frame's value is the mean over its labels, the scene's \
             the mean over frames.\n\
             - **In space**: truth is the labelled pixels of every {COUNTED_EVERY}th frame with depth, \
             back-projected with the true poses, in voxels of {VOXEL_METRES} m; found is the points of \
             the 3D answer at the bundle's threshold, moved by the trajectory's rigid alignment. \
             *Chamfer*: mean distance to the nearest, there and back, added. *EMD*: mean distance of \
             the best one-to-one pairs of {PAIRED} points of each, exact. A failure is farther than \
             mean + 2 standard deviations over the labels, as in the paper. A thing counts as there if \
             a counted frame shows it with {SEEN_PIXELS} pixels.\n\
             - **Present, absent**: the same classes, and {ABSENT_NOUNS} nouns of households that the \
             scene has not, asked of the whole map and of {VIEWS} views. *Calibration error*: ten bins \
             of confidence, mean of |confidence - share there|, weighted by size.\n"
        );
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::example::example_report;

    #[test]
    fn the_page_has_every_part() {
        let pictures = [("psnr.png".to_owned(), "PSNR over frames".to_owned())];
        let page = markdown(&example_report(), &pictures);
        for part in [
            "# room7: 40 frames of 320x240, poses given, language by the server's networks",
            "| PSNR held out, dB | 22.00 | 35.81 |",
            "another data set",
            "| sofa | 2 | 0.060 | 0.210 | 0.440 | 0.330 | 0.500 | 0.91 | 0.85 | 0.600 |",
            "IoU at 0.87",
            "half within 25 ms",
            "| wall | 900 | 4000 | 0.120 | 0.050 | 0.070 | – | 0.09, 0.05 |",
            "| chair | 7 | 8 |",
            "| 1 | 0.900 | 1.000 |",
            "| decode | 40 | 10.0 | 10.0 |",
            "every 8th frame",
            "![PSNR over frames](psnr.png)",
            "max_gaussians = 200000",
        ] {
            assert!(page.contains(part), "{part:?} in\n{page}");
        }
    }

    #[test]
    fn what_was_not_measured_is_not_there() {
        let report = Report { language: None, config: None, ..example_report() };
        let page = markdown(&report, &[]);
        assert!(!page.contains("## Words") && !page.contains("mIoU"), "{page}");
        assert!(page.contains("Not known"), "{page}");
    }
}
