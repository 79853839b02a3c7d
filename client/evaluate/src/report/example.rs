//! A report with a value in every field, for tests.

use super::paper::PAPER;
use super::record::Report;
use super::scaled::Scaled;
use crate::language::{ClassScore, LabelMeans, Language, Latency, MaskMeans};
use crate::presence::{Judgement, Presence};
use crate::probe::{Probe, ProbeTimes, REFERENCE, Repeated};
use crate::space::{CountScore, Space, SpaceMeans, SpaceScore};
use crate::stages::Stage;
use crate::trajectory::Ate;
use crate::uncertainty::{Part, Uncertainty};
use crate::views::{ViewMeans, ViewScore};

fn example_space() -> Space {
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

fn example_language(scene: LabelMeans) -> Language {
    let (label, query) = ("sofa".to_owned(), "sofa".to_owned());
    Language {
        file: None,
        test_frames: vec![1, 6],
        bundle_threshold: 0.87,
        scene,
        classes: vec![ClassScore { label, query, frames: 2, means: scene }],
        latency: Latency { questions: 20, p50_ms: 25.0, p99_ms: 310.0, mean_ms: 30.0 },
        scores: Vec::new(),
    }
}

fn example_uncertainty() -> Uncertainty {
    Uncertainty {
        pixels: 76_800,
        wrong: 0.05,
        wrong_least_certain: 0.31,
        wrong_rest: 0.021,
        calibration_error: 0.012,
        tenths: vec![Part { uncertainty: 0.3, wrong: 0.31 }],
    }
}

fn example_presence() -> Presence {
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

fn example_views() -> Vec<ViewScore> {
    let view = |sequence, keyframe, psnr_db| ViewScore {
        sequence,
        keyframe,
        psnr_db,
        ssim: 0.9,
        lpips: Some(0.08),
        depth_l1_m: Some(0.012),
        depth_share: Some(0.99),
    };
    vec![view(0, true, 24.0), view(1, false, 21.5), view(6, false, 22.5)]
}

/// The probe of a machine that takes twice as long as the reference.
pub fn example_probe() -> Probe {
    let part = |reference_ms: f64| Repeated {
        min_ms: reference_ms,
        median_ms: 2.0 * reference_ms,
        repetitions: 15,
    };
    let times = ProbeTimes {
        memory: part(REFERENCE.memory_ms),
        blend: part(REFERENCE.blend_ms),
        product: Some(part(REFERENCE.product_ms)),
        without_product: None,
    };
    // The mean of logarithms is not exact.
    Probe { relative_time: 2.0, ..Probe::new(times.clone(), times) }
}

/// A report with a value in every field.
pub fn example_report() -> Report {
    let masks = MaskMeans {
        share: 0.06,
        miou_paper: 0.21,
        miou_unscaled: 0.19,
        miou_bundle: 0.44,
        miou_released: 0.33,
        miou_argmax: 0.5,
        loc_mask: 0.85,
        average_precision: 0.6,
    };
    let scene = LabelMeans { loc_box: 0.91, loc_synonyms: None, masks: Some(masks) };
    let views = example_views();
    let stage = Stage { count: 40, seconds: 0.4, mean_ms: 10.0 };
    let stages = [("decode".to_owned(), stage)].into();
    let probe = example_probe();
    Report {
        dataset: "room7".into(),
        simulated: None,
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
        refined: None,
        seconds_per_frame_settled: 0.275,
        processor_seconds_per_frame: Some(0.5),
        scaled: Some(Scaled::new(&probe, [8.0, 3.0], &stages, 40)),
        probe: Some(probe),
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
        language: Some(example_language(scene)),
        space: Some(example_space()),
        presence: Some(example_presence()),
        uncertainty: Some(example_uncertainty()),
        stages,
        config: Some("[mapper]\nmax_gaussians = 200000\n".into()),
        paper: PAPER,
        views,
    }
}
