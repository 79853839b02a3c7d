//! Preparation of images, codes of images and of labels, and the bounded queue.

use super::prepare::Preparation;
use super::vision::cropped;
use super::*;
use crate::pipeline::compressor::GENERIC_SIZE;
use crate::pipeline::compressor::generic::CodeGrid;
use crate::pipeline::frame::{Frame, FrameUp, Intrinsics, Labels};
use crate::pipeline::network::{Bundle, ChannelOrder, Fit, ImageSpec};
use std::sync::mpsc;

fn frame(width: u32, height: u32, pixel: impl Fn(u32, u32) -> [u8; 3]) -> Frame {
    let rgb: Vec<u8> = (0..width * height).flat_map(|at| pixel(at % width, at / width)).collect();
    Frame {
        sequence: 0,
        timestamp_nanos: 0,
        intrinsics: Intrinsics { width, height, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 },
        depth_metres: vec![0.0; (width * height) as usize].into(),
        rgb: rgb.into(),
        depth_lag_nanos: 0,
        world_from_camera: None,
        hint: None,
        labels: None,
        held_out: false,
        up: FrameUp::default(),
    }
}

fn spec(width: usize, height: usize) -> ImageSpec {
    ImageSpec {
        width,
        height,
        fit: Fit::Squash,
        channel_order: ChannelOrder::Rgb,
        mean: [10.0, 20.0, 30.0],
        std: [2.0, 4.0, 5.0],
        antialias: true,
    }
}

struct Prepared {
    planes: Vec<f32>,
    covered: [f32; 2],
}

/// Prepares into memory that holds NaN.
fn prepare(frame: &Frame, spec: &ImageSpec) -> Prepared {
    let mut planes = vec![f32::NAN; 3 * spec.height * spec.width];
    let covered = Preparation::default().run(frame, spec, &mut planes);
    Prepared { planes, covered }
}

#[test]
fn an_image_of_the_right_size_is_only_normalised() {
    let image = frame(3, 2, |x, y| [x as u8, 100 + y as u8, 200]);
    let prepared = prepare(&image, &spec(3, 2));
    let red = [-5.0, -4.5, -4.0, -5.0, -4.5, -4.0];
    let green = [20.0, 20.0, 20.0, 20.25, 20.25, 20.25];
    assert_eq!(prepared.planes, [&red[..], &green, &[34.0; 6]].concat());
    assert_eq!(prepared.covered, [1.0, 1.0]);
}

#[test]
fn blue_is_first_for_bgr_networks() {
    let image = frame(1, 1, |_, _| [10, 60, 230]);
    let bgr = ImageSpec { channel_order: ChannelOrder::Bgr, ..spec(1, 1) };
    assert_eq!(prepare(&image, &bgr).planes, [110.0, 10.0, -4.0]);
    // Negative control: red first is another image.
    assert_eq!(prepare(&image, &spec(1, 1)).planes, [0.0, 10.0, 40.0]);
}

#[test]
fn shrinking_averages_and_squashing_fills() {
    // Columns alternate between 0 and 200. Samples without a filter would be one of them; the mean
    // is 100.
    let image = frame(64, 16, |x, _| [if x % 2 == 0 { 0 } else { 200 }; 3]);
    let prepared = prepare(&image, &spec(8, 8));
    assert_eq!(prepared.planes.len(), 3 * 64);
    // The outermost columns see only half of their neighbourhood.
    let inner = prepared.planes[..64].chunks_exact(8).flat_map(|row| &row[1..7]);
    assert!(inner.into_iter().all(|red| (red - 45.0).abs() < 1.0), "{:?}", &prepared.planes[..8]);
}

#[test]
fn padding_keeps_the_aspect_and_fills_with_the_mean() {
    let image = frame(8, 4, |_, _| [50; 3]);
    let padded = ImageSpec { fit: Fit::Pad, ..spec(4, 4) };
    let prepared = prepare(&image, &padded);
    assert_eq!(prepared.covered, [1.0, 0.5]);
    let red: Vec<f32> = [[20.0; 8], [0.0; 8]].concat();
    assert_eq!(prepared.planes[..16], red);
    // The cells below the image are cut off.
    let grid =
        CodeGrid { height: 4, width: 2, codes: (0..8 * GENERIC_SIZE).map(|i| i as f32).collect() };
    let kept = cropped(grid, prepared.covered);
    assert_eq!((kept.height, kept.width), (2, 2));
    assert_eq!(kept.codes, (0..4 * GENERIC_SIZE).map(|i| i as f32).collect::<Vec<_>>());
}

fn vision_only() -> crate::pipeline::network::VisionNetworks {
    Bundle::load(&LanguageConfig::default()).expect("models/tiny is part of the project").split().0
}

/// An embedder for frames without labels.
fn no_texts() -> Embed {
    Box::new(|text| panic!("nothing is labelled {text:?}"))
}

fn labelled(ids: Vec<u16>, texts: &[&str]) -> Frame {
    let texts = texts.iter().map(|text| (*text).to_owned()).collect();
    Frame { labels: Some(Labels { ids: ids.into(), texts }), ..frame(96, 72, |_, _| [50; 3]) }
}

#[test]
fn labels_become_the_codes_of_their_texts() {
    let (networks, text) = Bundle::load(&LanguageConfig::default())
        .expect("models/tiny is part of the project")
        .split();
    let mut tower = text.tower;
    let requested = std::sync::Arc::new(std::sync::Mutex::new(Vec::new()));
    let noted = requested.clone();
    let embed = move |text: &str| {
        noted.lock().expect("no thread panics").push(text.to_owned());
        tower.embed(text).map(Into::into).map_err(|error| error.to_string())
    };
    let mut vision = Vision::new(networks, Box::new(embed), &LanguageConfig::default());
    // One pixel per cell. Left a sofa; right a lamp under two labels; a row of label 0; a row of a
    // label with an empty text; a label that no pixel has.
    let ids = |at: u16| match (at % 96, at / 96) {
        (_, 0) => 0,
        (_, 1) => 4,
        (column, _) if column < 48 => 1,
        (column, _) => 2 + column % 2,
    };
    let image = labelled((0..96 * 72).map(ids).collect(), &["sofa", "lamp", "lamp", "", "bed"]);
    let found = vision.run(&image).expect("it runs");
    assert_eq!((found.width, found.height), (96, 72));
    let code = |column: usize, row: usize| {
        &found.codes[(row * 96 + column) * GENERIC_SIZE..][..GENERIC_SIZE]
    };
    assert!(code(3, 0).iter().chain(code(3, 1)).all(|value| *value == 0.0), "no language");
    let (sofa, lamp) = (code(3, 40), code(70, 40));
    assert_eq!((lamp, sofa), (code(71, 40), code(47, 71)), "one text, one code");
    let cosine: f32 = sofa.iter().zip(lamp).map(|(a, b)| a * b).sum();
    assert!(cosine < 0.9, "different texts, different codes: {cosine}");
    assert_eq!(
        *requested.lock().expect("no thread panics"),
        ["lamp", "sofa"],
        "each text once, and no other"
    );

    // A text that is compressed alone has the same code: cells are independent.
    let again = vision.run(&labelled(vec![1; 96 * 72], &["sofa"])).expect("it runs");
    assert_eq!(&again.codes[..GENERIC_SIZE], sofa, "from the cache");
    let image = labelled(vec![1; 96 * 72], &["a sofa"]);
    let other = vision.run(&image).expect("it runs");
    assert_ne!(&other.codes[..GENERIC_SIZE], sofa, "another text, another code");

    let mut failing = Vision::new(
        vision_only(),
        Box::new(|_| Err("out of words".into())),
        &LanguageConfig::default(),
    );
    let error = failing.run(&image).expect_err("there is no embedding");
    assert!(error.to_string().contains("out of words"), "{error}");
}

#[test]
fn a_frame_becomes_unit_codes_that_follow_the_image() {
    let mut vision = Vision::new(vision_only(), no_texts(), &LanguageConfig::default());
    let stripes =
        frame(160, 120, |x, y| [x as u8, 255 - y as u8, if x / 20 % 2 == 0 { 9 } else { 240 }]);
    let flat = frame(160, 120, |_, _| [128; 3]);
    let found = vision.run(&stripes).expect("it runs");
    let cells = (found.width * found.height) as usize;
    assert!(cells > 1000 && found.codes.len() == cells * GENERIC_SIZE);
    for code in found.codes.chunks_exact(GENERIC_SIZE) {
        let length: f32 = code.iter().map(|value| value * value).sum();
        assert!((length - 1.0).abs() < 1e-3, "{length}");
    }
    assert_eq!(vision.run(&stripes).expect("it runs").codes, found.codes);
    // Negative control: another image has other codes.
    assert_ne!(vision.run(&flat).expect("it runs").codes, found.codes);
}

#[test]
fn a_full_queue_gives_the_frame_back_and_tells_when_it_has_room() {
    let config = LanguageConfig { queue: 1, ..LanguageConfig::default() };
    let thread = LanguageThread::start(vision_only(), no_texts(), &config).expect("a thread");
    let image = |sequence| Frame { sequence, ..frame(8, 8, |_, _| [7; 3]) };
    let (started, has_started) = mpsc::sync_channel(1);
    let (go_on, may_go_on) = mpsc::sync_channel::<()>(1);
    let (done, results) = mpsc::sync_channel(2);
    let first_done = done.clone();
    let held = move |result: Result<LanguageMap, String>| {
        started.send(()).expect("the test waits");
        may_go_on.recv().expect("the test goes on");
        first_done.send(result.is_ok()).expect("the test listens");
    };
    let no_room_needed = || panic!("the queue had room");
    assert!(thread.submit(image(1), held, no_room_needed).is_ok());
    has_started.recv().expect("the first one runs");
    // The first frame occupies the thread, the second the queue; the third is refused.
    let reply = move |result: Result<LanguageMap, String>| {
        done.send(result.is_ok()).expect("the test listens");
    };
    assert!(thread.submit(image(2), reply, no_room_needed).is_ok());
    let (room, has_room) = mpsc::sync_channel(1);
    let on_room = move || room.send(()).expect("the test listens");
    let refused = thread.submit(image(3), |_| panic!("it was never taken"), on_room);
    assert_eq!(refused.expect_err("the queue is full").sequence, 3);
    assert_eq!(has_room.try_recv(), Err(mpsc::TryRecvError::Empty), "it is still full");
    go_on.send(()).expect("the thread waits");
    has_room.recv().expect("the thread takes the second one");
    assert_eq!([results.recv(), results.recv()], [Ok(true), Ok(true)]);
}
