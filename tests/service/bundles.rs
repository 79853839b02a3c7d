//! Bundles of other sizes and forms than the one that ships: 768 features, one graph or three, half
//! precision. The whole server maps with one, and a spoilt one is refused with what is wrong.

use lexsplat_server::pipeline::encoder::{LanguageConfig, Vision};
use lexsplat_server::pipeline::frame::{Frame, FrameUp, Intrinsics};
use lexsplat_server::pipeline::network::Bundle;
use lexsplat_tests::bundle::{Form, Made, WORDS, decompress, likeness};
use lexsplat_tests::onnx::Kind;
use lexsplat_tests::{Robot, Server, tiny_config};
use nalgebra::DMatrix;
use serde_json::{Value, json};
use std::path::Path;

const FORMS: [Form; 3] = [Form::Folded(Kind::F32), Form::Folded(Kind::F16), Form::Stages];

fn config(folder: &Path) -> LanguageConfig {
    LanguageConfig { models: folder.to_owned(), ..tiny_config().language }
}

fn written(made: &Made) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    made.write(folder.path());
    folder
}

/// A view as a frame of the pipeline.
fn frame(robot: &Robot, at: usize) -> Frame {
    let (width, height) = (robot.camera.width, robot.camera.height);
    Frame {
        sequence: at as u64,
        timestamp_nanos: 0,
        intrinsics: Intrinsics { width, height, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 },
        rgb: robot.views[at].rgb.clone().into(),
        depth_metres: robot.views[at].depth.clone().into(),
        depth_lag_nanos: 0,
        world_from_camera: None,
        hint: None,
        labels: None,
        held_out: false,
        up: FrameUp::default(),
    }
}

/// The least cosine between codes of the same cells.
fn least_cosine(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let rows = a.chunks_exact(32).zip(b.chunks_exact(32));
    rows.map(|(a, b)| a.iter().zip(b).map(|(a, b)| a * b).sum()).fold(1.0, f32::min)
}

#[test]
fn one_graph_says_what_three_do() {
    let robot = Robot::new(3, 2);
    let codes: Vec<[Vec<f32>; 2]> = FORMS
        .into_iter()
        .map(|form| {
            let folder = written(&Made::new(form));
            let config = config(folder.path());
            let vision = Bundle::load(&config).expect("it is right").split().0;
            let no_words = Box::new(|_: &str| Err("no labels are given".into()));
            let mut vision = Vision::new(vision, no_words, &config);
            // The same memory twice.
            [0, 1].map(|at| vision.run(&frame(&robot, at)).expect("it runs").codes)
        })
        .collect();
    let [folded, half, stages] = &codes[..] else { panic!("three forms") };
    for at in 0..2 {
        assert!(least_cosine(&folded[at], &stages[at]) > 0.9999);
        let cosine = least_cosine(&half[at], &stages[at]);
        assert!(cosine > 0.999 && half[at] != stages[at], "{cosine}");
    }
    // Negative control: the other view is another one.
    assert!(least_cosine(&folded[0], &stages[1]) < 0.99);
}

/// Pixels along one side of a cell of the bundle's grid, in the robot's views.
const CELL: usize = 10;

/// What a frame's heat map for a color should be, cell by cell, from its pixels alone: the relevancy
/// of the cell's mean color, averaged over 3x3 cells as answers are over 20 pixels.
fn expected(robot: &Robot, at: usize, color: [f64; 3]) -> (usize, Vec<f64>) {
    let width = robot.camera.width as usize;
    let (columns, rows) = (width / CELL, robot.camera.height as usize / CELL);
    let relevancy = |cell: usize| {
        let mut mean = [0.0; 3];
        for pixel in 0..CELL * CELL {
            let x = cell % columns * CELL + pixel % CELL;
            let y = cell / columns * CELL + pixel / CELL;
            let rgb = &robot.views[at].rgb[3 * (y * width + x)..];
            for (mean, &value) in mean.iter_mut().zip(rgb) {
                *mean += (f64::from(value) / 127.5 - 1.0) / (CELL * CELL) as f64;
            }
        }
        let like = likeness(mean, color);
        let against = WORDS[3..].iter().map(|&(_, negative)| likeness(mean, negative));
        against.map(|other| 1.0 / (1.0 + (10.0 * (other - like)).exp())).fold(1.0, f64::min)
    };
    let sharp: Vec<f64> = (0..columns * rows).map(relevancy).collect();
    let smooth = |cell: usize| {
        let (x, y) = (cell % columns, cell / columns);
        let near = |at: usize, limit: usize| at.saturating_sub(1)..(at + 2).min(limit);
        let around: Vec<f64> = near(y, rows)
            .flat_map(|y| near(x, columns).map(move |x| y * columns + x))
            .map(|cell| sharp[cell])
            .collect();
        around.iter().sum::<f64>() / around.len() as f64
    };
    (columns, (0..columns * rows).map(smooth).collect())
}

async fn ask(server: &Server, text: &str, frame: usize) -> Value {
    reqwest::Client::new()
        .post(server.url("/v1/maps/room/query"))
        .json(&json!({"text": text, "view": {"frame": frame}}))
        .send()
        .await
        .expect("the server answers")
        .json()
        .await
        .expect("with JSON")
}

#[tokio::test(flavor = "multi_thread")]
async fn the_server_maps_and_answers_with_768_features_in_half_precision() {
    let folder = written(&Made::new(Form::Folded(Kind::F16)));
    let mut config = tiny_config();
    config.language.models = folder.path().to_owned();
    let server = Server::start(config).await;
    assert_eq!(server.engine.bundle(), "colors");
    let robot = Robot::new(3, 8);
    let acks = server.stream(&robot, "room").await;
    assert!(acks.iter().any(|ack| ack.keyframe), "the first frame is one");
    server.settled("room").await;

    for (word, color) in [WORDS[0], WORDS[2]] {
        let answer = ask(&server, word, 0).await;
        let peak = &answer["peak"];
        let pixel = |axis: &str| peak[axis].as_f64().unwrap_or_else(|| panic!("{answer}")) as usize;
        let (columns, expected) = expected(&robot, 0, color);
        let highest = expected.iter().copied().fold(0.0, f64::max);
        let here = expected[pixel("y") / CELL * columns + pixel("x") / CELL] / highest;
        let chance = expected.iter().filter(|&&value| value > 0.7 * highest).count() as f64
            / expected.len() as f64;
        println!("{word}: {here:.2} of the highest there is; {chance:.3} of the cells have 0.7");
        assert!(here > 0.7, "{word}: {here} {answer}");
        // Negative control: a peak anywhere would hardly be there.
        assert!(chance < 0.25, "{word}: {chance}");
    }
    server.stop().await;
}

type Spoil = fn(&mut Made);

#[test]
fn a_spoilt_bundle_is_refused_with_file_tensor_expected_and_found() {
    let cases: [(&str, Form, Spoil, &[&str]); 6] = [
        (
            "another grid",
            Form::Folded(Kind::F32),
            |made| made.manifest = made.manifest.replace("[24, 32]", "[24, 33]"),
            &["vision.onnx", "\"codes\"", "[1, 32, 24, 33]", "[1, 32, 24, 32]"],
        ),
        (
            "another input",
            Form::Folded(Kind::F32),
            |made| made.manifest = made.manifest.replace("width = 128", "width = 64"),
            &["vision.onnx", "\"image\"", "[1, 3, 96, 64]", "[1, 3, 96, 128]"],
        ),
        (
            "a decoder to another size",
            Form::Folded(Kind::F32),
            |made| {
                let smaller = decompress(&DMatrix::from_element(384, 32, 0.1));
                made.replace("decompress.onnx", smaller);
            },
            &["decompress.onnx", "\"features\"", "f32[?, 768]", "[?, 384]"],
        ),
        (
            "tokens where an image should be",
            Form::Folded(Kind::F32),
            |made| {
                let text = made.files.iter().find(|(name, _)| *name == "text.onnx");
                let text = text.expect("it has one").1.clone();
                made.replace("vision.onnx", text);
            },
            &["vision.onnx", "\"image\"", "input_ids"],
        ),
        (
            "half a file",
            Form::Stages,
            |made| made.files[1].1.truncate(4000),
            &["srd.onnx", "ONNX Runtime"],
        ),
        (
            "no file",
            Form::Stages,
            |made| made.files.retain(|(name, _)| *name != "compress.onnx"),
            &["compress.onnx", "sha256", "none"],
        ),
    ];
    for (name, form, spoil, says) in cases {
        let mut made = Made::new(form);
        // Negative control: what was not spoilt loads.
        assert!(Bundle::load(&config(written(&made).path())).is_ok(), "{name}");
        spoil(&mut made);
        let Err(error) = Bundle::load(&config(written(&made).path())) else {
            panic!("{name}: it loads");
        };
        let error = error.to_string();
        for part in says {
            assert!(error.contains(part), "{name}: expected {part:?} in {error:?}");
        }
    }
}
