//! Every number of an evaluation, as it is serialised; a value without ground truth is null.

use super::paper::{PAPER, Paper};
use super::scaled::Scaled;
use crate::language::Language;
use crate::options::Options;
use crate::presence::Presence;
use crate::probe::Probe;
use crate::space::Space;
use crate::stages::Stage;
use crate::trajectory::Ate;
use crate::uncertainty::Uncertainty;
use crate::views::{ViewMeans, ViewScore};
use crate::words::LanguageScores;
use lexsplat_client::dataset::Dataset;
use lexsplat_client::http::{Health, Status};
use lexsplat_client::stream::{Encoder, Poses, Summary};
use serde::Serialize;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;

/// Every number of an evaluation. The first ones serve to compare runs.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Name of the data set.
    pub dataset: String,
    /// What was done to simulate a sensor or a shaking camera; scores are against clean frames.
    pub simulated: Option<String>,
    /// Columns and rows of the frames.
    pub frame_size: [u32; 2],
    /// "given" or "estimate".
    pub poses: &'static str,
    /// "bundle" (the server's networks) or "oracle" (the true classes' names).
    pub encoder: &'static str,
    /// N if every N-th frame was held out.
    pub hold_out_every: Option<usize>,
    /// Graphics adapter of the server.
    pub adapter: String,
    /// Bundle of networks of the server.
    pub bundle: String,
    /// Version of the server.
    pub version: String,
    /// Number of frames sent.
    pub frames: u64,
    /// Number of frames with a pose.
    pub frames_tracked: u64,
    /// Number of frames without a pose.
    pub frames_lost: u64,
    /// Number of frames that the server refused.
    pub frames_refused: u64,
    /// Frames per second from the opening of the stream to the last acknowledgement, with language.
    pub fps: f64,
    /// Inverse of `fps`.
    pub seconds_per_frame: f64,
    /// Seconds from the last acknowledgement until the map was settled.
    pub settle_seconds: f64,
    /// Seconds of streaming and settling per frame.
    pub seconds_per_frame_settled: f64,
    /// Processor time of the server per frame, user and system, from the opening of the stream until
    /// the map was settled, seconds; null if it is not a process of this machine that was started
    /// for the evaluation.
    pub processor_seconds_per_frame: Option<f64>,
    /// How the map was refined before it was scored; null if it was not waited for.
    pub refined: Option<Refined>,
    /// The times above and the stages', as they would be on the probe's reference machine.
    pub scaled: Option<Scaled>,
    /// The probe of the machine; null if the server runs on another one.
    pub probe: Option<Probe>,
    /// Number of keyframes.
    pub keyframes: u64,
    /// Number of Gaussians in the settled map.
    pub gaussians: u64,
    /// Device memory of the Gaussians, bytes.
    pub gpu_bytes: u64,
    /// Memory of the keyframes' images and codes, on the host and the device, bytes.
    pub keyframe_bytes: u64,
    /// Peak resident memory of the server, bytes.
    pub peak_rss_bytes: Option<u64>,
    /// Trajectory error (RMSE) after rigid alignment, centimetres.
    pub ate_rmse_cm: Option<f64>,
    /// Mean PSNR of the held-out views, decibels.
    pub psnr_db: Option<f64>,
    /// Mean SSIM of the held-out views.
    pub ssim: Option<f64>,
    /// Mean LPIPS of the held-out views, if there was a network.
    pub lpips: Option<f64>,
    /// Mean depth error of the held-out views, metres.
    pub depth_l1_m: Option<f64>,
    /// Mean IoU at 0.5 with smoothing.
    pub miou: Option<f64>,
    /// Share of peaks in a box of the label.
    pub loc_accuracy: Option<f64>,
    /// Mean Chamfer distance of the 3D answers, metres.
    pub chamfer_m: Option<f64>,
    /// Mean earth mover's distance of the 3D answers, metres.
    pub emd_m: Option<f64>,
    /// Share of absent nouns that the server reports as absent.
    pub absent_accuracy: Option<f64>,
    /// The trajectory in detail.
    pub ate: Option<Ate>,
    /// Means over views that the map was not optimised for.
    pub held_out: ViewMeans,
    /// Means over views that the map was optimised for.
    pub keyframe_views: ViewMeans,
    /// Queries about frames.
    pub language: Option<Language>,
    /// Queries about the whole map.
    pub space: Option<Space>,
    /// Presence and absence.
    pub presence: Option<Presence>,
    /// Uncertainty of the pixels of answers about frames.
    pub uncertainty: Option<Uncertainty>,
    /// Stages by name, from the opening of the stream until the map was settled.
    pub stages: BTreeMap<String, Stage>,
    /// Settings of the server as TOML, if they are known.
    pub config: Option<String>,
    /// The paper's figures.
    pub paper: Paper,
    /// Scores of every rendered view.
    pub views: Vec<ViewScore>,
}

/// The refinement of a settled map.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Refined {
    /// Seconds until the map had converged.
    pub seconds: f64,
    /// Processor time of the server meanwhile, user and system, seconds; null if it is not known.
    pub processor_seconds: Option<f64>,
}

/// The results that a report is made of.
pub(crate) struct Measured<'a> {
    pub dataset: &'a dyn Dataset,
    pub options: Options,
    pub health: Health,
    pub summary: Summary,
    pub status: Status,
    pub settle_seconds: f64,
    pub refined: Option<Refined>,
    pub peak_rss_bytes: Option<u64>,
    pub ate: Option<Ate>,
    pub views: Vec<ViewScore>,
    pub words: Option<LanguageScores>,
    pub stages: BTreeMap<String, Stage>,
    pub processor_seconds: Option<f64>,
    pub probe: Option<Probe>,
}

impl Report {
    pub(crate) fn new(measured: Measured<'_>) -> Self {
        let Measured { dataset, summary, status, health, settle_seconds, views, .. } = measured;
        let held_out = ViewMeans::of(views.iter().filter(|view| !view.keyframe));
        let keyframe_views = ViewMeans::of(views.iter().filter(|view| view.keyframe));
        let Words { language, space, presence, uncertainty } = words(measured.words);
        let scene = language.as_ref().map(|language| language.scene);
        let per_frame = |seconds: f64| seconds / summary.sent.max(1) as f64;
        Self {
            dataset: dataset.name().to_owned(),
            simulated: dataset.simulated(),
            frame_size: frame_size(dataset),
            encoder: encoder_name(measured.options.encoder),
            hold_out_every: measured.options.hold_out_every.map(NonZeroUsize::get),
            poses: poses_name(measured.options.poses),
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
            processor_seconds_per_frame: measured.processor_seconds.map(per_frame),
            refined: measured.refined,
            scaled: measured.probe.as_ref().map(|probe| {
                let seconds = [summary.seconds, settle_seconds];
                Scaled::new(probe, seconds, &measured.stages, summary.sent)
            }),
            probe: measured.probe,
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
            miou: scene.and_then(|scene| Some(scene.masks?.miou_paper)),
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
            uncertainty,
            stages: measured.stages,
            config: None,
            paper: PAPER,
            views,
        }
    }
}

/// The scores of language, each absent if it was not measured.
#[derive(Default)]
struct Words {
    language: Option<Language>,
    space: Option<Space>,
    presence: Option<Presence>,
    uncertainty: Option<Uncertainty>,
}

fn words(scores: Option<LanguageScores>) -> Words {
    let Some(LanguageScores { language, space, presence, uncertainty }) = scores else {
        return Words::default();
    };
    Words { language: Some(language), space, presence: Some(presence), uncertainty }
}

fn frame_size(dataset: &dyn Dataset) -> [u32; 2] {
    let camera = dataset.intrinsics();
    [camera.width, camera.height]
}

fn encoder_name(encoder: Encoder) -> &'static str {
    match encoder {
        Encoder::Bundle => "bundle",
        Encoder::Oracle => "oracle",
    }
}

fn poses_name(poses: Poses) -> &'static str {
    match poses {
        Poses::Given => "given",
        Poses::Estimate => "estimate",
    }
}

#[cfg(test)]
mod tests {
    use crate::report::example::example_report;

    #[test]
    fn the_json_has_the_documented_names() {
        let json = serde_json::to_value(example_report()).unwrap();
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
            "processor_seconds_per_frame",
            "probe",
        ] {
            assert!(json.get(name).is_some(), "{name}");
        }
        assert_eq!(json["psnr_db"], 22.0);
        assert!(json["emd_m"].is_null(), "what is not measured is null");
        assert_eq!(json["language"]["classes"][0]["miou_bundle"], 0.44);
        assert_eq!(json["chamfer_m"], 0.12);
        assert_eq!(json["space"]["counts"][0]["there"], 8);
        assert_eq!(json["stages"]["decode"]["mean_ms"], 10.0);
        assert_eq!(json["probe"]["relative_time"], 2.0);
        assert_eq!(json["scaled"]["stages_mean_ms"]["decode"], 5.0);
    }
}
