//! The report as a page of Markdown: numbers beside the paper's, classes, stages, protocol and the
//! server's settings. Images are only referred to.

use super::label_table::label_table;
use super::machine::machine;
use super::protocol::protocol;
use super::record::Report;
use super::rows::rows;
use crate::language::Language;
use crate::presence::{Presence, Reliability};
use crate::space::{CountScore, Space, SpaceScore};
use crate::table::{Column, markdown_table};
use std::fmt::Write as _;

/// The report as Markdown; `pictures` are the names and captions of files beside it.
pub fn markdown(report: &Report, pictures: &[(String, String)]) -> String {
    let mut page = heading(report);
    page += &overview(report);
    if let Some(language) = &report.language {
        page += &classes(language, report.presence.as_ref());
    }
    page += &report.space.as_ref().map(space).unwrap_or_default();
    page += &report.presence.as_ref().map(presence).unwrap_or_default();
    page += &stages(report);
    page += &report.probe.as_ref().map(machine).unwrap_or_default();
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

fn heading(report: &Report) -> String {
    let [width, height] = report.frame_size;
    format!(
        "# {}: {} frames of {width}x{height}, poses {}, {}\n\nlexsplat {} on {}; networks: {}.\n\n{}",
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
        report.bundle,
        match &report.simulated {
            Some(simulated) => format!("Simulated sensor: {simulated}.\n\n"),
            None => String::new(),
        }
    )
}

/// The most important numbers beside the paper's.
fn overview(report: &Report) -> String {
    let columns = [
        Column::left("what"),
        Column::right("here"),
        Column::left("the paper (another data set: 8 Replica scenes, tracked poses)"),
    ];
    let cells: Vec<Vec<String>> =
        rows(report).into_iter().map(|row| vec![row.what.into(), row.value, row.paper]).collect();
    let mut page = markdown_table(&columns, &cells);
    if let Some(ate) = &report.ate {
        line(
            &mut page,
            format_args!(
                "\nATE over {} of {} tracked frames: RMSE {:.3} cm, mean {:.3}, median {:.3}, \
                 maximum {:.3}.",
                ate.frames,
                report.frames_tracked,
                ate.rmse_cm,
                ate.mean_cm,
                ate.median_cm,
                ate.max_cm
            ),
        );
    }
    page
}

/// The first column is of words, the others are of numbers.
fn named_columns<'a>(names: &[&'a str]) -> Vec<Column<'a>> {
    let column = |(at, name): (usize, &&'a str)| match at {
        0 => Column::left(name),
        _ => Column::right(name),
    };
    names.iter().enumerate().map(column).collect()
}

fn classes(language: &Language, presence: Option<&Presence>) -> String {
    let table = label_table(language, presence, false);
    let labels = match &language.file {
        Some(file) => format!("The {} labels of {file}", language.classes.len()),
        None => format!("The {} classes with most pixels", language.classes.len()),
    };
    format!(
        "\n## Queries about frames\n\n{labels}, asked by name in {} frames; {} queries, median latency \
         {:.0} ms, 99th percentile {:.0} ms.\n\n{}",
        language.test_frames.len(),
        language.latency.questions,
        language.latency.p50_ms,
        language.latency.p99_ms,
        markdown_table(&table.columns(), &table.rows)
    )
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
    let columns = named_columns(&[
        "class",
        "points",
        "voxels",
        "Chamfer",
        "found to truth",
        "truth to found",
        "EMD",
        "the paper's Chamfer, EMD (its room0, the class of that name)",
    ]);
    let metres =
        |value: Option<f64>| value.map_or_else(|| "–".into(), |value| format!("{value:.3}"));
    let row = |one: &SpaceScore| {
        let paper = PAPER_ROOM0.iter().find(|(label, ..)| *label == one.label);
        vec![
            one.label.clone(),
            one.points.to_string(),
            one.truth_voxels.to_string(),
            metres(one.chamfer_m),
            metres(one.found_to_truth_m),
            metres(one.truth_to_found_m),
            metres(one.emd_m),
            paper.map(|(_, chamfer, emd)| format!("{chamfer}, {emd}")).unwrap_or_default(),
        ]
    };
    let cells: Vec<Vec<String>> = space.labels.iter().map(row).collect();
    let count =
        |one: &CountScore| vec![one.class.clone(), one.found.to_string(), one.there.to_string()];
    let counts: Vec<Vec<String>> = space.counts.iter().map(count).collect();
    format!(
        "\n## Queries about the whole map\n\nThe same classes; points above {:.2}; metres.\n\n{}\n\
         Objects of a class in the answer and in the frames:\n\n{}",
        space.threshold,
        markdown_table(&columns, &cells),
        markdown_table(&named_columns(&["class", "counted", "there"]), &counts)
    )
}

fn presence(presence: &Presence) -> String {
    let Reliability { ece, brier, bins } = &presence.reliability;
    let columns = ["answers", "mean confidence", "share there"].map(Column::right);
    let cells: Vec<Vec<String>> = bins
        .iter()
        .map(|bin| {
            let shares = [bin.confidence, bin.there].map(|share| format!("{share:.3}"));
            [vec![bin.count.to_string()], shares.to_vec()].concat()
        })
        .collect();
    let mut page = format!(
        "\n## Presence\n\n{} answers. Calibration error of `confidence` {ece:.3}, Brier score \
         {brier:.3}.\n\n{}",
        presence.judgements.len(),
        markdown_table(&columns, &cells)
    );
    if let Some(fitted) = &presence.fitted {
        line(
            &mut page,
            format_args!(
                "\nBest fit to these answers: {:.3} times the logit of `confidence`, plus {:.3}. For a \
                 bundle with `confidence_steepness` s and `present_threshold` p that means {:.3} s, and p \
                 less {:.3} / ({:.3} s). On the answers that it was fitted to, the calibration error is \
                 {:.3} and the Brier score {:.3}.",
                fitted.scale,
                fitted.offset,
                fitted.scale,
                fitted.offset,
                fitted.scale,
                fitted.reliability.ece,
                fitted.reliability.brier
            ),
        );
    }
    let wrong: Vec<String> = presence
        .judgements
        .iter()
        .filter(|one| one.frame.is_none() && one.present != one.there)
        .map(|one| {
            let verdict = if one.there { "not found" } else { "reported as present" };
            format!("{} ({verdict}, {:.2})", one.text, one.confidence)
        })
        .collect();
    if !wrong.is_empty() {
        line(&mut page, format_args!("\nWrong answers about the whole map: {}.", wrong.join(", ")));
    }
    page
}

fn stages(report: &Report) -> String {
    let columns = named_columns(&["stage", "runs", "mean, ms", "ms per frame"]);
    let cells: Vec<Vec<String>> = report
        .stages
        .iter()
        .map(|(name, stage)| {
            let per_frame = stage.seconds * 1e3 / report.frames.max(1) as f64;
            let times = [stage.mean_ms, per_frame].map(|time| format!("{time:.1}"));
            [vec![name.clone(), stage.count.to_string()], times.to_vec()].concat()
        })
        .collect();
    format!(
        "\n## Stages\n\nFrom the opening of the stream until the map was settled, as the server reports \
         it. Stages run in parallel, and `frame` includes the time in the queue: they do not add up to \
         the time of a frame.\n\n{}",
        markdown_table(&columns, &cells)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::example::example_report;

    /// The page with single spaces: tables are padded.
    fn unpadded(page: &str) -> String {
        let line = |line: &str| line.split_whitespace().collect::<Vec<_>>().join(" ");
        page.lines().map(line).collect::<Vec<_>>().join("\n")
    }

    #[test]
    fn the_page_has_every_part() {
        let pictures = [("psnr.png".to_owned(), "PSNR over frames".to_owned())];
        let page = unpadded(&markdown(&example_report(), &pictures));
        for part in [
            "# room7: 40 frames of 320x240, poses given, language by the server's networks",
            "| PSNR held out, dB | 22.00 | 35.81 |",
            "another data set",
            "| sofa | 2 | 0.060 | 0.210 | 0.440 | 0.330 | 0.500 | 0.91 | 0.85 | 0.600 | yes |",
            "IoU at 0.87",
            "median latency 25 ms",
            "| wall | 900 | 4000 | 0.120 | 0.050 | 0.070 | – | 0.09, 0.05 |",
            "| chair | 7 | 8 |",
            "| 1 | 0.900 | 1.000 |",
            "| decode | 40 | 10.0 | 10.0 |",
            "every 8th frame",
            "It took 2.00 times as long",
            "![PSNR over frames](psnr.png)",
            "max_gaussians = 200000",
        ] {
            assert!(page.contains(part), "{part:?} in\n{page}");
        }
    }

    #[test]
    fn missing_scores_are_left_out_of_the_page() {
        let report = Report { language: None, config: None, ..example_report() };
        let page = markdown(&report, &[]);
        assert!(!page.contains("## Queries about frames") && !page.contains("mIoU"), "{page}");
        assert!(page.contains("Not known"), "{page}");
    }
}
