//! An evaluation from end to end: a synthetic room is streamed, mapped, rendered, asked and scored.

use lexsplat_client::Access;
use lexsplat_client::dataset::FrameRange;
use lexsplat_client::stream::{Encoder, Poses};
use lexsplat_evaluate::{EvaluateError, Options, Report, Step, Target, evaluate, markdown, plot};
use lexsplat_synthetic::SyntheticDataset;
use lexsplat_tests::{Server, tiny_config};
use std::num::NonZeroUsize;
use std::sync::Arc;

const FRAMES: usize = 18;

fn options(language: bool) -> Options {
    let hold_out_every = NonZeroUsize::new(4);
    Options { poses: Poses::Given, encoder: Encoder::Bundle, hold_out_every, language, lpips: None }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_room_is_measured_and_a_used_map_is_refused() {
    let server = Server::start(tiny_config()).await;
    let range = FrameRange { end: Some(FRAMES), ..FrameRange::default() };
    let open = || Arc::from(range.of(Box::new(SyntheticDataset::new(8))).expect("it is made"));
    let (grpc, http) = (server.grpc.clone(), server.http.clone());
    let target = Target { grpc, http, access: Access::default(), map: "measured".into() };
    let mut steps = [false; 6];
    let on_step = |step: Step<'_>| {
        let at = match step {
            Step::Streaming(_) => 0,
            Step::Settling(_) => 1,
            Step::Rendering { .. } => 2,
            Step::Asking { .. } => 3,
            Step::Locating { .. } => 4,
            Step::Judging { .. } => 5,
        };
        steps[at] = true;
    };
    let measured = evaluate(open(), &target, options(true), on_step).await.expect("it is measured");
    let report = &measured.report;
    println!("{}", markdown(report, &[]));
    assert!(steps[0] && steps[2..].iter().all(|step| *step), "{steps:?}");

    assert_eq!(
        (report.frames, report.frames_tracked, report.frames_lost),
        (FRAMES as u64, FRAMES as u64, 0)
    );
    assert!(report.fps > 0.0 && report.gaussians > 1000 && report.keyframes >= 2);
    // Given poses come back as they were, but for the digits of the text.
    let ate = report.ate.expect("the room knows its poses");
    assert_eq!(ate.frames, FRAMES, "{ate:?}");
    assert!(ate.max_cm < 1e-5, "{ate:?}");
    assert_eq!(report.held_out.views + report.keyframe_views.views, report.views.len());
    assert!(report.held_out.views >= 2 && report.keyframe_views.views >= 2);
    // Measured over 24 frames on llvmpipe: 22.1 dB, 0.64, 0.17 m.
    assert!(
        report.psnr_db.is_some_and(|psnr| (15.0..40.0).contains(&psnr)),
        "{:?}",
        report.held_out
    );
    assert!(report.ssim.is_some_and(|ssim| (0.3..1.0).contains(&ssim)), "{:?}", report.held_out);
    assert!(report.depth_l1_m.is_some_and(|l1| l1 < 0.35), "{:?}", report.held_out);
    let mapping = ["tracking", "insertion", "mapping", "compression", "snapshot"];
    for stage in ["decode", "frame", "language"].into_iter().chain(mapping) {
        assert!(report.stages.contains_key(stage), "{stage} in {:?}", report.stages);
    }
    assert!(report.peak_rss_bytes.is_some_and(|bytes| bytes > 50 << 20));

    assert_language_is_scored(report);
    assert!(measured.samples.len() == 4 && plot::psnr(&report.views).is_some());
    assert!(plot::stages(&report.stages, report.frames).is_some());

    let again = evaluate(open(), &target, options(false), |_| {}).await;
    assert!(
        matches!(again, Err(EvaluateError::MapInUse { frames, .. }) if frames == FRAMES as u64),
        "{again:?}"
    );
    server.stop().await;
}

fn assert_language_is_scored(report: &Report) {
    let language = report.language.as_ref().expect("the room knows its things");
    assert_eq!(language.bundle_threshold, 0.5);
    assert!(language.classes.len() >= 5, "{:?}", language.classes);
    let scene = &language.scene;
    // Knows much more than a map that knows nothing, whose precision is the share.
    assert!(scene.average_precision > 2.0 * scene.share, "{scene:?}");
    assert!(scene.loc_box > 0.5 && scene.loc_box >= scene.loc_mask, "{scene:?}");
    let space = report.space.as_ref().expect("the room knows its things");
    assert_eq!(space.labels.len(), language.classes.len());
    let chamfer = space.means.chamfer_m.expect("something is found");
    // Found within a room of four metres, and not where nothing is.
    assert!(chamfer < 1.5 && report.chamfer_m == Some(chamfer), "{space:?}");
    assert!(space.means.emd_m.is_some_and(|emd| emd > 0.0 && emd < 3.0), "{space:?}");
    assert!(!space.counts.is_empty(), "{space:?}");
    let presence = report.presence.as_ref().expect("the room knows its things");
    assert!(presence.judgements.len() > 100 && report.absent_accuracy.is_some());
    assert!(plot::reliability(presence).is_some());
}
