//! Images are prepared as the manifest says, and the bundle makes unit codes of them.

use super::*;
use crate::pipeline::frame::Intrinsics;
use crate::pipeline::network::{Bundle, ChannelOrder, Fit};
use std::sync::mpsc;

fn frame(width: u32, height: u32, pixel: impl Fn(u32, u32) -> [u8; 3]) -> Frame {
    let rgb: Vec<u8> = (0..width * height).flat_map(|at| pixel(at % width, at / width)).collect();
    Frame {
        sequence: 0,
        timestamp_nanos: 0,
        intrinsics: Intrinsics { width, height, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 },
        depth_metres: vec![0.0; (width * height) as usize].into(),
        rgb: rgb.into(),
        world_from_camera: None,
        hint: None,
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

/// Into memory that is not clean.
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
fn blue_is_first_where_the_network_wants_it() {
    let image = frame(1, 1, |_, _| [10, 60, 230]);
    let bgr = ImageSpec { channel_order: ChannelOrder::Bgr, ..spec(1, 1) };
    assert_eq!(prepare(&image, &bgr).planes, [110.0, 10.0, -4.0]);
    // Negative control: red first is another image.
    assert_eq!(prepare(&image, &spec(1, 1)).planes, [0.0, 10.0, 40.0]);
}

#[test]
fn shrinking_averages_and_squashing_fills() {
    // Columns alternate between 0 and 200: a sampled pixel would be one of them, the mean is 100.
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
        CodeGrid { height: 4, width: 2, codes: (0..8 * GENERIC).map(|i| i as f32).collect() };
    let kept = cropped(grid, prepared.covered);
    assert_eq!((kept.height, kept.width), (2, 2));
    assert_eq!(kept.codes, (0..4 * GENERIC).map(|i| i as f32).collect::<Vec<_>>());
}

fn vision() -> crate::pipeline::network::VisionNetworks {
    Bundle::load(&LanguageConfig::default()).expect("models/tiny is part of the project").split().0
}

#[test]
fn a_frame_becomes_unit_codes_that_follow_the_image() {
    let mut vision = Vision::new(vision());
    let stripes =
        frame(160, 120, |x, y| [x as u8, 255 - y as u8, if x / 20 % 2 == 0 { 9 } else { 240 }]);
    let flat = frame(160, 120, |_, _| [128; 3]);
    let found = vision.run(&stripes).expect("it runs");
    let cells = (found.width * found.height) as usize;
    assert!(cells > 1000 && found.codes.len() == cells * GENERIC);
    for code in found.codes.chunks_exact(GENERIC) {
        let length: f32 = code.iter().map(|value| value * value).sum();
        assert!((length - 1.0).abs() < 1e-3, "{length}");
    }
    assert_eq!(vision.run(&stripes).expect("it runs").codes, found.codes);
    // Negative control: another image has other codes.
    assert_ne!(vision.run(&flat).expect("it runs").codes, found.codes);
}

#[test]
fn a_full_queue_gives_the_frame_back() {
    let config = LanguageConfig { queue: 1, ..LanguageConfig::default() };
    let thread = LanguageThread::start(vision(), &config).expect("a thread");
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
    assert!(thread.try_submit(image(1), held).is_ok());
    has_started.recv().expect("the first one runs");
    // The first is in work and holds the thread, the second waits, the third has no place.
    let reply = move |result: Result<LanguageMap, String>| {
        done.send(result.is_ok()).expect("the test listens");
    };
    assert!(thread.try_submit(image(2), reply).is_ok());
    let refused = thread.try_submit(image(3), |_| panic!("it was never taken"));
    assert_eq!(refused.expect_err("the queue is full").sequence, 3);
    go_on.send(()).expect("the thread waits");
    assert_eq!([results.recv(), results.recv()], [Ok(true), Ok(true)]);
}
