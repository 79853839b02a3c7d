//! An evaluation from end to end: a synthetic room is streamed, mapped, rendered, asked and scored. And two
//! builds of the server that are compared in turns.

use lexsplat_client::Access;
use lexsplat_client::dataset::{Dataset as _, FrameRange};
use lexsplat_client::stream::{Encoder, Poses};
use lexsplat_evaluate::{
    EvaluateError, LabelSource, Options, Report, Step, Target, evaluate, markdown, plot,
};
use lexsplat_synthetic::SyntheticDataset;
use lexsplat_tests::{Server, program, root, tiny_config};
use serde_json::{Value, json};
use std::fs::Permissions;
use std::num::NonZeroUsize;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::Arc;

const FRAMES: usize = 18;

fn options(labels: Option<LabelSource>) -> Options {
    let hold_out_every = NonZeroUsize::new(4);
    let (poses, encoder) = (Poses::Given, Encoder::Bundle);
    Options { poses, encoder, hold_out_every, labels, lpips: None, converged: false }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_room_is_measured_and_a_used_map_is_refused() {
    let server = Server::start(tiny_config()).await;
    let range = FrameRange { end: Some(FRAMES), ..FrameRange::default() };
    let open = || Arc::from(range.of(Box::new(SyntheticDataset::new(8))).expect("it is made"));
    let (grpc, http) = (server.grpc.clone(), server.http.clone());
    let process = Some(std::process::id());
    let target = Target { grpc, http, access: Access::default(), map: "measured".into(), process };
    let mut steps = [false; 7];
    let on_step = |step: Step<'_>| {
        let at = match step {
            Step::Streaming(_) => 0,
            Step::Settling(_) => 1,
            Step::Rendering { .. } => 2,
            Step::Asking { .. } => 3,
            Step::Locating { .. } => 4,
            Step::Judging { .. } => 5,
            Step::Probing => 6,
        };
        steps[at] = true;
    };
    let measured = evaluate(open(), &target, options(Some(LabelSource::Masks)), on_step)
        .await
        .expect("it is measured");
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
    let mapping = ["tracking", "insertion", "mapping", "compression"];
    for stage in ["decode", "frame", "language"].into_iter().chain(mapping) {
        assert!(report.stages.contains_key(stage), "{stage} in {:?}", report.stages);
    }
    assert!(report.peak_rss_bytes.is_some_and(|bytes| bytes > 50 << 20));
    let probe = report.probe.as_ref().expect("the server runs on this machine");
    assert!(probe.relative_time > 0.0 && report.scaled.is_some(), "{probe:?}");
    assert!(report.processor_seconds_per_frame.is_some_and(|seconds| seconds > 0.0));

    assert_language_is_scored(report);
    assert!(measured.samples.len() == 4 && plot::psnr(&report.views).is_some());
    assert!(plot::stages(&report.stages, report.frames).is_some());

    let again = evaluate(open(), &target, options(None), |_| {}).await;
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
    let masks = scene.masks.expect("the room has masks");
    assert!(masks.average_precision > 2.0 * masks.share, "{scene:?}");
    assert!(scene.loc_box > 0.5 && scene.loc_box >= masks.loc_mask, "{scene:?}");
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

/// `lexsplat evaluate --versus BINARY` with a clock that makes the same map every time.
fn versus(binary: &Path, rounds: &str, out: &Path) -> Output {
    let mut command = Command::new(program("lexsplat"));
    command.args(["evaluate", "--dataset", "synthetic:8", "--frames", "8", "--held-out", "4"]);
    command.args(["--config", "configs/tiny.toml", "--rounds", rounds, "--versus"]).arg(binary);
    command.arg("--out").arg(out).env("LEXSPLAT__MAPPER__CLOCK", "per_frame");
    command.current_dir(root()).output().expect("it runs")
}

/// The comparison that a run wrote.
fn written(run: &Output, out: &Path) -> Value {
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let text = std::fs::read(out.join("versus.json")).expect("it is written");
    serde_json::from_slice(&text).expect("it is JSON")
}

/// A quantity of a comparison.
fn quantity<'a>(comparison: &'a Value, what: &str) -> &'a Value {
    let quantities = comparison["quantities"].as_array().expect("a list");
    quantities.iter().find(|one| one["what"] == what).expect(what)
}

const QUALITY: [&str; 6] = [
    "PSNR held out, dB",
    "SSIM held out",
    "depth L1 held out, m",
    "PSNR keyframes, dB",
    "ATE RMSE, cm",
    "Gaussians",
];

/// Times are never checked, only that they are there.
#[test]
fn a_build_is_as_good_as_itself_and_one_with_fewer_steps_is_not() {
    let folder = tempfile::tempdir().expect("a folder");
    let server = program("lexsplat-server");
    let run = versus(&server, "2", folder.path());
    let same = written(&run, folder.path());
    assert_eq!((&same["rounds"], &same["frames"]), (&2.into(), &8.into()));
    for what in QUALITY {
        let ratio = &quantity(&same, what)["ratio"];
        for value in ["mean", "lowest", "highest"] {
            assert_eq!(ratio[value], 1.0, "{what}: {ratio}");
        }
    }
    let times = ["seconds per frame, all work done", "processor time per frame, s"];
    for what in times.into_iter().chain(["tracking, ms per frame", "mapping, ms per frame"]) {
        let time = quantity(&same, what);
        assert_eq!(time["that"].as_array().map(Vec::len), Some(2), "{time}");
        assert!(time["ratio"]["lowest"].as_f64() > Some(0.0), "{time}");
        let is_scaled = time["scaled_ratio"]["mean"].as_f64() > Some(0.0);
        assert_eq!(is_scaled, !what.contains("processor"), "{time}");
    }
    assert!(quantity(&same, "peak memory of the server, MiB")["ratio"].is_object());
    let said = String::from_utf8_lossy(&run.stdout);
    assert!(said.contains("this/that") && said.contains("PSNR held out, dB"), "{said}");
    for turn in ["this-1", "that-1", "this-2", "that-2"] {
        assert!(folder.path().join(turn).join("report.json").is_file(), "{turn}");
    }
    // Negative control.
    let fewer = folder.path().join("fewer");
    let script = format!(
        "#!/bin/sh\nLEXSPLAT__MAPPER__STEPS_PER_KEYFRAME=1 exec '{}' \"$@\"\n",
        server.display()
    );
    std::fs::write(&fewer, script).expect("it is written");
    std::fs::set_permissions(&fewer, Permissions::from_mode(0o755)).expect("it is ours");
    let out = folder.path().join("out");
    let other = written(&versus(&fewer, "1", &out), &out);
    let psnr = &quantity(&other, "PSNR held out, dB")["ratio"]["mean"];
    assert!(psnr.as_f64() > Some(1.0), "{psnr}");
}

/// `lexsplat evaluate --labels FILE` on the first frames of a room.
fn labelled(file: &Path, labels: &Value, out: &Path) -> Output {
    std::fs::write(file, labels.to_string()).expect("it is written");
    let mut command = Command::new(program("lexsplat"));
    command.args(["evaluate", "--dataset", "synthetic:8", "--frames", "8", "--held-out", "4"]);
    command.args(["--config", "configs/tiny.toml", "--labels"]).arg(file).arg("--out").arg(out);
    command.current_dir(root()).output().expect("it runs")
}

#[test]
fn the_labels_of_a_file_are_asked_in_its_frames() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("labels.json");
    let dataset = SyntheticDataset::new(8);
    let (width, height) = (dataset.intrinsics().width, dataset.intrinsics().height);
    let everywhere = json!([[0, 0, width, height]]);
    let object = |boxes: &Value| json!({"label": "sofa", "boxes": boxes});
    let frame = |number: u64, boxes: &Value| json!({"frame": number, "objects": [object(boxes)]});
    // The last frame is in the room, but not among those that are sent.
    let frames = json!([
        frame(3, &everywhere),
        frame(5, &json!([[0, 0, 1, 1]])),
        frame(dataset.len() as u64 - 1, &everywhere)
    ]);
    let queries = json!([{"label": "sofa", "query": "sofa", "synonyms": ["couch"]}]);
    let mut labels = json!({"queries": queries, "frames": frames, "absent": ["piano", "bicycle"]});
    let run = labelled(&file, &labels, folder.path());
    let said = String::from_utf8_lossy(&run.stdout);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    assert!(said.contains("Loc synonyms") && said.contains("absent said rightly"), "{said}");
    let text = std::fs::read(folder.path().join("report.json")).expect("it is written");
    let report: Value = serde_json::from_slice(&text).expect("it is JSON");
    let language = &report["language"];
    assert_eq!(language["test_frames"], json!([3, 5]), "{language}");
    assert_eq!(language["file"], "labels.json");
    // A box that is the frame has every peak, and one of a pixel has none.
    let class = &language["classes"][0];
    assert_eq!((&class["loc_box"], &class["loc_synonyms"]), (&json!(0.5), &json!(0.5)), "{class}");
    assert!(report["miou"].is_null() && report["space"].is_null(), "boxes are no masks");
    assert_eq!(report["loc_accuracy"], 0.5);
    let judged = report["presence"]["judgements"].as_array().expect("a list").len();
    assert_eq!(judged, 1 + 2 + 2 * (1 + 2), "the map, and both frames");

    labels["frames"][0]["objects"][0]["label"] = "sofas".into();
    let run = labelled(&file, &labels, folder.path());
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(said.contains("frame 3: label \"sofas\" is not among the queries"), "{said}");
    assert!(!run.status.success());
}

#[test]
fn a_binary_that_is_no_server_is_refused_before_anything_is_measured() {
    let folder = tempfile::tempdir().expect("a folder");
    for (binary, expected) in [
        (folder.path().join("nowhere"), "a copy of"),
        ("/bin/false".into(), "is no build of lexsplat-server"),
    ] {
        let run = versus(&binary, "2", folder.path());
        let said = String::from_utf8_lossy(&run.stderr);
        assert!(!run.status.success() && said.contains(expected), "{said}");
        assert!(!said.contains("round 1"), "{said}");
    }
}
