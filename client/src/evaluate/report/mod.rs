//! The report: every number of an evaluation, for programs (`report.json`) and in rows for people.
//! In: what was measured. Out: a [`Report`] that serialises; what has no ground truth is null.

mod page;
mod rows;

use super::language::Language;
use super::presence::Presence;
use super::space::Space;
use super::stages::Stage;
use super::trajectory::Ate;
use super::views::{ViewMeans, ViewScore};
use super::{Options, Words};
use crate::dataset::Dataset;
use crate::http::{Health, Status};
use crate::stream::{Encoder, Poses, Summary};
use serde::Serialize;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;

/// What the paper says of its own runs: means over the Replica scenes of vMAP, tracked poses.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Paper {
    /// Table 1.
    pub miou: f64,
    /// Table 1.
    pub loc_accuracy: f64,
    /// Supplement, 3D localisation, failures left out, metres.
    pub chamfer_m: f64,
    /// The same; of pairs that are not one to one.
    pub emd_m: f64,
    /// Rendering.
    pub psnr_db: f64,
    /// Rendering.
    pub ssim: f64,
    /// Rendering, AlexNet.
    pub lpips: f64,
    /// Tracking.
    pub ate_rmse_cm: f64,
    /// On one large GPU, least and most.
    pub seconds_per_frame: [f64; 2],
}

/// The paper's figures.
pub const PAPER: Paper = Paper {
    miou: 0.487,
    loc_accuracy: 0.826,
    chamfer_m: 0.736,
    emd_m: 5.695,
    psnr_db: 35.81,
    ssim: 0.950,
    lpips: 0.072,
    ate_rmse_cm: 0.397,
    seconds_per_frame: [0.6, 0.8],
};

/// Every number. Those at the top are the ones to compare runs by.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The data set's name.
    pub dataset: String,
    /// Columns and rows of its frames.
    pub frame_size: [u32; 2],
    /// "given" or "estimate".
    pub poses: &'static str,
    /// "bundle" (the server's networks) or "oracle" (the true classes' names).
    pub encoder: &'static str,
    /// Every so many frames one was only tracked, if so.
    pub hold_out_every: Option<usize>,
    /// What the server renders on.
    pub adapter: String,
    /// Its networks.
    pub bundle: String,
    /// Its version.
    pub version: String,
    /// Frames sent.
    pub frames: u64,
    /// Of those, with a pose.
    pub frames_tracked: u64,
    /// Of those, without.
    pub frames_lost: u64,
    /// Of those, refused.
    pub frames_refused: u64,
    /// Frames over the time from the stream's opening to the last acknowledgement, language on.
    pub fps: f64,
    /// The inverse.
    pub seconds_per_frame: f64,
    /// From the last acknowledgement until the map had done its work.
    pub settle_seconds: f64,
    /// Streaming and settling over frames.
    pub seconds_per_frame_settled: f64,
    /// Keyframes.
    pub keyframes: u64,
    /// Gaussians of the settled map.
    pub gaussians: u64,
    /// Device memory of the Gaussians.
    pub gpu_bytes: u64,
    /// Memory of the keyframes' pictures and codes, the device's too.
    pub keyframe_bytes: u64,
    /// The most memory that the server's process had.
    pub peak_rss_bytes: Option<u64>,
    /// Of the trajectory after rigid alignment.
    pub ate_rmse_cm: Option<f64>,
    /// Of the held-out views.
    pub psnr_db: Option<f64>,
    /// Of the held-out views.
    pub ssim: Option<f64>,
    /// Of the held-out views, if there was a network for it.
    pub lpips: Option<f64>,
    /// Of the held-out views.
    pub depth_l1_m: Option<f64>,
    /// At 0.5 with smoothing, mean over frames.
    pub miou: Option<f64>,
    /// Peaks in a box of the label.
    pub loc_accuracy: Option<f64>,
    /// Of the 3D answers, mean over labels, metres.
    pub chamfer_m: Option<f64>,
    /// Of the 3D answers, mean over labels, metres.
    pub emd_m: Option<f64>,
    /// Share of absent nouns of which the server says so.
    pub absent_accuracy: Option<f64>,
    /// The trajectory in detail.
    pub ate: Option<Ate>,
    /// Frames that nothing was optimised for.
    pub held_out: ViewMeans,
    /// Frames that the map was optimised for.
    pub keyframe_views: ViewMeans,
    /// Words in views.
    pub language: Option<Language>,
    /// Words in space.
    pub space: Option<Space>,
    /// Words that are there, and that are not.
    pub presence: Option<Presence>,
    /// By name, from the stream's opening until the map was settled.
    pub stages: BTreeMap<String, Stage>,
    /// The server's settings as TOML, if they are known.
    pub config: Option<String>,
    /// What the paper says.
    pub paper: Paper,
    /// Every rendered frame.
    pub views: Vec<ViewScore>,
}

/// What a report is made of.
pub(super) struct Measured<'a> {
    pub dataset: &'a dyn Dataset,
    pub options: Options,
    pub health: Health,
    pub summary: Summary,
    pub status: Status,
    pub settle_seconds: f64,
    pub peak_rss_bytes: Option<u64>,
    pub ate: Option<Ate>,
    pub views: Vec<ViewScore>,
    pub words: Option<Words>,
    pub stages: BTreeMap<String, Stage>,
}

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

impl Report {
    pub(super) fn new(measured: Measured<'_>) -> Self {
        let Measured { dataset, summary, status, health, settle_seconds, views, .. } = measured;
        let camera = dataset.intrinsics();
        let held_out = ViewMeans::of(views.iter().filter(|view| !view.keyframe));
        let keyframe_views = ViewMeans::of(views.iter().filter(|view| view.keyframe));
        let (language, space, presence) = match measured.words {
            Some(Words { language, space, presence }) => {
                (Some(language), Some(space), Some(presence))
            }
            None => (None, None, None),
        };
        let scene = language.as_ref().map(|language| language.scene);
        let per_frame = |seconds: f64| seconds / summary.sent.max(1) as f64;
        Self {
            dataset: dataset.name().to_owned(),
            frame_size: [camera.width, camera.height],
            encoder: match measured.options.encoder {
                Encoder::Bundle => "bundle",
                Encoder::Oracle => "oracle",
            },
            hold_out_every: measured.options.hold_out_every.map(NonZeroUsize::get),
            poses: match measured.options.poses {
                Poses::Given => "given",
                Poses::Estimate => "estimate",
            },
            adapter: health.adapter,
            bundle: health.bundle,
            version: health.version,
            frames: summary.sent,
            frames_tracked: summary.tracked,
            frames_lost: summary.lost,
            frames_refused: summary.refused,
            fps: summary.frames_per_second,
            seconds_per_frame: per_frame(summary.seconds),
            settle_seconds,
            seconds_per_frame_settled: per_frame(summary.seconds + settle_seconds),
            keyframes: status.keyframes,
            gaussians: status.gaussians,
            gpu_bytes: status.gpu_bytes,
            keyframe_bytes: status.keyframe_bytes,
            peak_rss_bytes: measured.peak_rss_bytes,
            ate_rmse_cm: measured.ate.map(|ate| ate.rmse_cm),
            psnr_db: held_out.psnr_db,
            ssim: held_out.ssim,
            lpips: held_out.lpips,
            depth_l1_m: held_out.depth_l1_m,
            miou: scene.map(|scene| scene.miou_paper),
            loc_accuracy: scene.map(|scene| scene.loc_box),
            chamfer_m: space.as_ref().and_then(|space| space.means.chamfer_m),
            emd_m: space.as_ref().and_then(|space| space.means.emd_m),
            absent_accuracy: presence.as_ref().and_then(|presence| presence.absent_accuracy),
            ate: measured.ate,
            held_out,
            keyframe_views,
            language,
            space,
            presence,
            stages: measured.stages,
            config: None,
            paper: PAPER,
            views,
        }
    }

    /// The numbers to look at first.
    pub fn rows(&self) -> Vec<Row> {
        rows::of(self)
    }

    /// The report as Markdown; `pictures` are the names and captions of files beside it.
    pub fn markdown(&self, pictures: &[(String, String)]) -> String {
        page::markdown(self, pictures)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::evaluate::language::{ClassScore, LabelMeans, Latency};
    use crate::evaluate::presence::Judgement;
    use crate::evaluate::space::{CountScore, SpaceMeans, SpaceScore};

    fn some_space() -> Space {
        let label = SpaceScore {
            label: "wall".into(),
            points: 900,
            truth_voxels: 4000,
            found_to_truth_m: Some(0.05),
            truth_to_found_m: Some(0.07),
            chamfer_m: Some(0.12),
            emd_m: None,
        };
        let means = SpaceMeans { chamfer_m: Some(0.12), unanswered: 1, ..SpaceMeans::default() };
        let counts = vec![CountScore { class: "chair".into(), there: 8, found: 7 }];
        let counted_within_one = Some(1.0);
        Space { threshold: 0.5, means, labels: vec![label], counts, counted_within_one }
    }

    fn some_language(scene: LabelMeans) -> Language {
        Language {
            test_frames: vec![1, 6],
            bundle_threshold: 0.87,
            scene,
            classes: vec![ClassScore { label: "sofa".into(), frames: 2, means: scene }],
            latency: Latency { questions: 20, p50_ms: 25.0, p99_ms: 310.0, mean_ms: 30.0 },
            scores: Vec::new(),
        }
    }

    fn some_presence() -> Presence {
        Presence::of(
            vec![Judgement {
                text: "sofa".into(),
                frame: None,
                there: true,
                present: true,
                confidence: 0.9,
            }],
            &["sofa".to_owned()],
        )
    }

    /// A report with something everywhere.
    pub fn some_report() -> Report {
        let scene = LabelMeans {
            share: 0.06,
            miou_paper: 0.21,
            miou_unscaled: 0.19,
            miou_bundle: 0.44,
            miou_released: 0.33,
            miou_argmax: 0.5,
            loc_box: 0.91,
            loc_mask: 0.85,
            average_precision: 0.6,
        };
        let view = |sequence, keyframe, psnr_db| ViewScore {
            sequence,
            keyframe,
            psnr_db,
            ssim: 0.9,
            lpips: Some(0.08),
            depth_l1_m: Some(0.012),
            depth_share: Some(0.99),
        };
        let views = vec![view(0, true, 24.0), view(1, false, 21.5), view(6, false, 22.5)];
        let stage = Stage { count: 40, seconds: 0.4, mean_ms: 10.0 };
        Report {
            dataset: "room7".into(),
            frame_size: [320, 240],
            poses: "given",
            encoder: "bundle",
            hold_out_every: Some(8),
            adapter: "software".into(),
            bundle: "tiny".into(),
            version: "1".into(),
            frames: 40,
            frames_tracked: 39,
            frames_lost: 1,
            frames_refused: 0,
            fps: 5.0,
            seconds_per_frame: 0.2,
            settle_seconds: 3.0,
            seconds_per_frame_settled: 0.275,
            keyframes: 9,
            gaussians: 12345,
            gpu_bytes: 3 << 20,
            keyframe_bytes: 30 << 20,
            peak_rss_bytes: Some(512 << 20),
            ate_rmse_cm: Some(0.0),
            psnr_db: Some(22.0),
            ssim: Some(0.9),
            lpips: Some(0.08),
            depth_l1_m: Some(0.012),
            miou: Some(0.21),
            loc_accuracy: Some(0.91),
            chamfer_m: Some(0.12),
            emd_m: None,
            absent_accuracy: Some(0.8),
            ate: Some(Ate { rmse_cm: 0.0, mean_cm: 0.0, median_cm: 0.0, max_cm: 0.0, frames: 39 }),
            held_out: ViewMeans::of(views.iter().filter(|view| !view.keyframe)),
            keyframe_views: ViewMeans::of(views.iter().filter(|view| view.keyframe)),
            language: Some(some_language(scene)),
            space: Some(some_space()),
            presence: Some(some_presence()),
            stages: [("decode".to_owned(), stage)].into(),
            config: Some("[mapper]\nmax_gaussians = 200000\n".into()),
            paper: PAPER,
            views,
        }
    }

    #[test]
    fn programs_find_the_names_that_were_promised() {
        let json = serde_json::to_value(some_report()).unwrap();
        for name in [
            "frames",
            "fps",
            "seconds_per_frame",
            "gaussians",
            "peak_rss_bytes",
            "ate_rmse_cm",
            "psnr_db",
            "ssim",
            "lpips",
            "depth_l1_m",
            "miou",
            "loc_accuracy",
            "chamfer_m",
            "emd_m",
            "absent_accuracy",
            "stages",
        ] {
            assert!(json.get(name).is_some(), "{name}");
        }
        assert_eq!(json["psnr_db"], 22.0);
        assert!(json["emd_m"].is_null(), "what is not measured is null");
        assert_eq!(json["language"]["classes"][0]["miou_bundle"], 0.44);
        assert_eq!(json["chamfer_m"], 0.12);
        assert_eq!(json["space"]["counts"][0]["there"], 8);
        assert_eq!(json["stages"]["decode"]["mean_ms"], 10.0);
    }

    #[test]
    fn rows_keep_held_out_and_keyframes_apart_and_name_the_paper() {
        let rows = some_report().rows();
        let row = |what: &str| rows.iter().find(|row| row.what == what).unwrap();
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
        let without = Report { language: None, psnr_db: None, ..some_report() };
        assert!(!without.rows().iter().any(|row| row.what.contains("mIoU")));
    }
}
