//! Requests to a small map: a couch on the left, a banana on the right.

use super::*;
use crate::pipeline::compressor::{
    CompressorConfig, GENERIC_SIZE, OnlineStage, normalise_rows, online,
};
use crate::pipeline::encoder::LanguageConfig;
use crate::pipeline::frame::Intrinsics;
use crate::pipeline::frame::TrackedFrame;
use crate::pipeline::network::{Bundle, Tensor, TextNetworks};
use crate::pipeline::snapshot::{KeyframeInfo, MapSnapshot};
use lexsplat_gpu::{Gpu, HostGaussians};
use nalgebra::Isometry3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

const CAMERA: Intrinsics =
    Intrinsics { width: 160, height: 120, fx: 140.0, fy: 140.0, cx: 79.5, cy: 59.5 };
/// Gaussians along one side of a square, and how far apart they are, metres.
const SIDE: usize = 20;
const STEP: f32 = 0.03;

fn bundle() -> TextNetworks {
    Bundle::load(&LanguageConfig::default()).expect("models/tiny is part of the project").split().1
}

/// A generic code that is decoded to nearly the embedding of a word, by random search in a
/// shrinking neighbourhood. Not all bundles have an encoder for single features.
fn code_of(text: &mut TextNetworks, word: &str) -> Vec<f32> {
    const TRIED: usize = 512;
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let embedding = text.tower.embed(word).expect("it runs");
    let (mut best, mut nearest) = (vec![0.0; GENERIC_SIZE], -1.0_f32);
    for round in 0..40 {
        let reach = 0.9_f32.powi(round);
        let mut tried: Vec<f32> = (0..TRIED * GENERIC_SIZE)
            .map(|at| best[at % GENERIC_SIZE] + reach * random.random_range(-1.0_f32..1.0))
            .collect();
        normalise_rows(&mut tried, GENERIC_SIZE);
        let input = [Tensor::floats(&[TRIED, GENERIC_SIZE], tried.clone())];
        let decoded = text.decompressor.run(&input).expect("it runs").swap_remove(0);
        let decoded = decoded.as_floats();
        for (code, feature) in tried.chunks_exact(GENERIC_SIZE).zip(decoded.chunks(embedding.len()))
        {
            let cosine = feature.iter().zip(&embedding).map(|(a, b)| a * b).sum();
            if cosine > nearest {
                (best, nearest) = (code.to_vec(), cosine);
            }
        }
    }
    assert!(nearest > 0.8, "no code for {word:?}: {nearest}");
    best
}

/// A square of Gaussians, facing the camera, in the plane z = 2 m.
fn add_square(map: &mut HostGaussians, left: f32, color: [f32; 3], code: &[f32]) {
    for at in 0..SIDE * SIDE {
        let offset = |i: usize| (i as f32 - (SIDE - 1) as f32 / 2.0) * STEP;
        map.means.push([left + offset(at % SIDE), offset(at / SIDE), 2.0]);
        for (head, feature) in [(&mut map.color, &color[..]), (&mut map.language, code)] {
            head.rotations.push([1.0, 0.0, 0.0, 0.0]);
            head.log_scales.push([0.6_f32 * STEP; 3].map(f32::ln));
            head.opacity_logits.push(3.0);
            head.features.extend_from_slice(feature);
            head.channels = feature.len();
        }
    }
}

struct Room {
    snapshot: Arc<MapSnapshot>,
    thread: QueryThread,
}

fn room(config: &QueryConfig) -> Room {
    let mut text = bundle();
    let words = ["couch", "banana", "lamp", "floor"];
    let codes: Vec<Vec<f32>> = words.iter().map(|word| code_of(&mut text, word)).collect();
    let mut stage = online(&CompressorConfig::default());
    stage.observe(&codes.concat());
    let mut map = HostGaussians::default();
    add_square(&mut map, -0.5, [0.9, 0.1, 0.1], &stage.encode(&codes[0]));
    add_square(&mut map, 0.5, [0.9, 0.8, 0.1], &stage.encode(&codes[1]));
    let gpu = Gpu::new(None).expect("a Vulkan adapter");
    let thread = QueryThread::start(gpu, text, config).expect("a thread");
    Room { snapshot: Arc::new(snapshot(map, stage)), thread }
}

fn snapshot(map: HostGaussians, stage: Box<dyn OnlineStage>) -> MapSnapshot {
    let frame = TrackedFrame {
        sequence: 7,
        timestamp_nanos: 0,
        world_from_camera: Isometry3::identity(),
        covariance: None,
        exposure: [0.0; 2],
    };
    MapSnapshot {
        map: "room".into(),
        revision: 3,
        through: None,
        gaussians: Arc::new(map),
        online: stage.into(),
        trajectory: Arc::new(vec![frame]),
        keyframes: Arc::new(vec![KeyframeInfo {
            frame,
            intrinsics: CAMERA,
            rgb: Arc::default(),
            has_language: false,
        }]),
        evidence: Arc::default(),
        up: None,
    }
}

fn query(text: &str, view: Option<View>) -> Query {
    Query {
        text: text.into(),
        negatives: vec![],
        outputs: if view.is_some() { Outputs::VIEW } else { Outputs::SPACE },
        view,
        threshold: None,
        smoothing_pixels: Some(5),
        max_objects: 10,
        filter: SpatialFilter::default(),
    }
}

fn wait<T>(future: impl Future<Output = T>) -> T {
    let runtime = tokio::runtime::Builder::new_current_thread().build().expect("a runtime");
    runtime.block_on(future)
}

impl Room {
    fn ask(&self, query: Query) -> Result<Answer, QueryError> {
        wait(self.thread.ask(&Client::Server, self.snapshot.clone(), query))
    }

    fn render(&self, channel: Channel) -> RenderedImage {
        let request = RenderRequest { view: View::Frame(7), channel, size: None };
        wait(self.thread.render(&Client::Server, self.snapshot.clone(), request))
            .expect("it renders")
    }
}

#[test]
fn a_text_is_found_in_a_view() {
    let room = room(&QueryConfig::default());
    // A synonym of the text on the left, then the text on the right.
    for (word, center) in [("sofa", 79.5 - 35.0), ("banana", 79.5 + 35.0)] {
        let answer = room.ask(query(word, Some(View::Frame(7)))).expect("an answer");
        assert!(answer.present && answer.confidence > 0.5, "{word}: {:?}", answer.peak);
        let peak = answer.peak.expect("a view has a peak");
        assert!((peak.x - center).abs() < 22.0, "{word}: {peak:?}");
        let best = answer.boxes.as_ref().expect("it was requested")[0];
        assert!((best.x + best.width / 2.0 - center).abs() < 6.0, "{word}: {best:?}");
        assert!((best.width - 42.0).abs() < 12.0, "{word}: {best:?}");
        // Two squares of 42 pixels in 160x120.
        assert!((answer.coverage - 0.184).abs() < 0.04, "{}", answer.coverage);
        let heatmap = answer.heatmap.expect("it was requested");
        assert_eq!((heatmap.width, heatmap.height, heatmap.values.len()), (160, 120, 160 * 120));
        assert!(heatmap.values.iter().all(|value| (0.0..=1.0).contains(value)));
        // The background is not relevant.
        assert!(heatmap.values[0] < 0.01);
    }
}

/// Whether all points lie on the square at `left`, and each of its Gaussians has one nearby.
fn covers(points: &[ScoredPoint], left: f32) -> bool {
    let half = SIDE as f32 / 2.0 * STEP;
    let is_on = |point: &ScoredPoint| {
        let off = point.position - nalgebra::Point3::new(left, 0.0, 2.0);
        off.amax() < half + STEP && off.z.abs() < STEP
    };
    let offset = |i: usize| (i as f32 - (SIDE - 1) as f32 / 2.0) * STEP;
    let is_near = |at: usize| {
        let center = nalgebra::Point3::new(left + offset(at % SIDE), offset(at / SIDE), 2.0);
        points.iter().any(|point| (point.position - center).norm() < STEP)
    };
    points.iter().all(is_on) && (0..SIDE * SIDE).all(is_near)
}

#[test]
fn a_text_is_found_in_space() {
    let room = room(&QueryConfig::default());
    for (word, x) in [("sofa", -0.5), ("banana", 0.5)] {
        let answer = room.ask(query(word, None)).expect("an answer");
        assert!(answer.present, "{word}: {:?}", answer.objects);
        let objects = answer.objects.as_ref().expect("it was requested");
        assert_eq!(objects.len(), 1, "{word}: {objects:?}");
        let expected = nalgebra::Point3::new(x, 0.0, 2.0);
        assert!((objects[0].center - expected).norm() < 0.05, "{word}: {:?}", objects[0]);
        assert_eq!(objects[0].points, SIDE * SIDE);
        assert!(covers(&answer.points.expect("it was requested"), x), "{word}");
        assert_eq!(answer.coverage, 1.0);
    }
    // Negative control: an absent thing is not found.
    let answer = room.ask(query("bicycle", None)).expect("an answer");
    let couch = room.ask(query("couch", None)).expect("an answer");
    assert!(answer.confidence < couch.confidence, "{:?}", answer.objects);
    assert!(!answer.present, "{:?}", answer.objects);
}

#[test]
fn a_map_beyond_the_cache_gives_the_same_answer() {
    let cached = room(&QueryConfig::default());
    let uncached = room(&QueryConfig { feature_cache_mib: 0, ..QueryConfig::default() });
    let [a, b] = [&cached, &uncached].map(|room| room.ask(query("sofa", None)).expect("an answer"));
    assert_eq!(a.points, b.points);
    // A second, cached answer is the same.
    assert_eq!(cached.ask(query("sofa", None)).expect("an answer").points, a.points);
    // Negative control: another text has other points.
    assert_ne!(cached.ask(query("banana", None)).expect("an answer").points, a.points);
}

#[test]
fn an_empty_map_has_no_coverage() {
    let room = room(&QueryConfig::default());
    let stage = online(&CompressorConfig::default());
    // As a map is before its first keyframe.
    let empty = Arc::new(snapshot(HostGaussians::default(), stage));
    for view in [None, Some(View::Frame(7))] {
        let answer = wait(room.thread.ask(&Client::Server, empty.clone(), query("couch", view)))
            .expect("an answer");
        assert!(!answer.present && answer.coverage == 0.0 && answer.confidence == 0.0);
        assert!(answer.objects.is_none_or(|objects| objects.is_empty()));
    }
    for channel in
        [Channel::Color, Channel::Depth, Channel::Language, Channel::Opacity, Channel::Spread]
    {
        let request = RenderRequest { view: View::Frame(7), channel, size: Some((8, 6)) };
        wait(room.thread.render(&Client::Server, empty.clone(), request)).expect("it renders");
    }
}

#[test]
fn a_panic_costs_one_answer_and_not_the_thread() {
    let room = room(&QueryConfig::default());
    let failed =
        wait(room.thread.run(&Client::Server, |_| -> Result<(), _> { panic!("on purpose") }));
    assert!(matches!(failed, Err(QueryError::Panicked)), "{failed:?}");
    assert!(room.ask(query("sofa", None)).expect("an answer").present);
}

#[test]
fn errors_name_the_invalid_field() {
    let room = room(&QueryConfig::default());
    let fault = |query: Query| {
        let error = room.ask(query).expect_err("it is invalid");
        (error.field(), error.to_string())
    };
    let (field, message) = fault(query("couch", Some(View::Frame(8))));
    assert_eq!(field, Some("view.frame"));
    assert!(message.contains("found 8"), "{message}");
    assert_eq!(fault(query(" ", None)).0, Some("text"));
    assert_eq!(fault(query(&"a".repeat(1025), None)).0, Some("text"));
    let negatives = vec!["thing".to_owned(); 33];
    assert_eq!(fault(Query { negatives, ..query("couch", None) }).0, Some("negatives"));
    let threshold = Some(f32::NAN);
    assert_eq!(fault(Query { threshold, ..query("couch", None) }).0, Some("threshold"));
    let huge = Intrinsics { width: 5000, ..CAMERA };
    let view = View::Camera { intrinsics: huge, world_from_camera: Isometry3::identity() };
    assert_eq!(fault(query("couch", Some(view))).0, Some("view.camera"));
    // Negative control: the thread still answers a valid query.
    assert!(room.ask(query("couch", None)).is_ok());
}

fn segmentation(texts: &[&str], view: Option<View>) -> SegmentationRequest {
    SegmentationRequest {
        texts: texts.iter().map(|&text| text.to_owned()).collect(),
        negatives: vec![],
        view,
        threshold: None,
        smoothing_pixels: Some(5),
    }
}

#[test]
fn pixels_and_gaussians_are_labelled() {
    let room = room(&QueryConfig::default());
    let ask = |request: SegmentationRequest| {
        wait(room.thread.segment(&Client::Server, room.snapshot.clone(), request))
            .expect("an answer")
    };
    let found = ask(segmentation(&["banana", "sofa"], Some(View::Frame(7))));
    let image = found.image.expect("a view has an image");
    assert_eq!((image.width, image.height, image.labels.len()), (160, 120, 160 * 120));
    let at = |column: usize| image.labels[60 * 160 + column];
    assert_eq!((at(44), at(115), at(0)), (2, 1, 0));
    // Two squares of 42 pixels in 160x120.
    assert!(found.shares.iter().all(|share| (share - 0.092).abs() < 0.03), "{:?}", found.shares);
    let points = ask(segmentation(&["banana", "sofa"], None)).points.expect("space has points");
    assert_eq!(points.len(), 2 * SIDE * SIDE);
    assert!(points.iter().all(|point| point.label == if point.position.x < 0.0 { 2 } else { 1 }));
    // Negative control: with the texts in the other order, labels are exchanged.
    let points = ask(segmentation(&["sofa", "banana"], None)).points.expect("space has points");
    assert!(points.iter().all(|point| point.label == if point.position.x < 0.0 { 1 } else { 2 }));
    // No pixel has a label above a threshold that none reaches.
    let strict =
        SegmentationRequest { threshold: Some(1.0), ..segmentation(&["banana", "sofa"], None) };
    assert_eq!(ask(strict).shares, [0.0, 0.0]);
    let fault = |request| {
        let result = wait(room.thread.segment(&Client::Server, room.snapshot.clone(), request));
        result.expect_err("it is invalid").field()
    };
    assert_eq!(fault(segmentation(&[], None)), Some("texts"));
    assert_eq!(fault(segmentation(&["sofa", " "], None)), Some("texts"));
    assert_eq!(fault(segmentation(&["sofa", "cup"], Some(View::Frame(8)))), Some("view.frame"));
}

#[test]
fn the_spatial_filter_limits_and_sorts_objects() {
    // Both squares are reported, although one of them matches better.
    let room = room(&QueryConfig { object_score: 0.0, ..QueryConfig::default() });
    let point = |x: f32| nalgebra::Point3::new(x, 0.0, 2.0);
    let ask = |filter: SpatialFilter| {
        // A threshold that both squares exceed.
        let query = Query { filter, threshold: Some(0.0), ..query("sofa", None) };
        let answer = room.ask(query).expect("an answer");
        (answer.objects.expect("it was requested"), answer.points.expect("it was requested"))
    };
    let (all, points) = ask(SpatialFilter::default());
    assert!(all.len() == 2 && points.iter().any(|point| point.position.x < 0.0));
    let right: Vec<_> = points.into_iter().filter(|point| point.position.x > 0.0).collect();
    assert!(covers(&right, 0.5));
    for x in [-0.9, 0.9] {
        let (found, _) = ask(SpatialFilter { near: Some(point(x)), within: None });
        assert!(found[0].center.x * x > 0.0, "the nearest is on the same side: {found:?}");
        assert!((found[0].distance.expect("there is a point") - 0.115).abs() < 0.02, "{found:?}");
    }
    let within = Some(Bounds {
        min: nalgebra::Point3::new(0.0, -1.0, 1.0),
        max: nalgebra::Point3::new(1.0, 1.0, 3.0),
    });
    let (found, points) = ask(SpatialFilter { near: None, within });
    assert!(found.len() == 1 && covers(&points, 0.5));
    assert!(points.iter().all(|point| point.position.x > 0.0) && found[0].center.x > 0.0);
}

#[test]
fn a_doubtful_object_is_not_reported_beside_a_sure_one() {
    let room = room(&QueryConfig::default());
    let answer =
        room.ask(Query { threshold: Some(0.0), ..query("sofa", None) }).expect("an answer");
    let objects = answer.objects.expect("it was requested");
    assert_eq!(objects.len(), 1);
    assert!(objects[0].center.x < 0.0, "the sofa is on the left: {objects:?}");
}

#[test]
fn a_mesh_has_codes_and_relevancies() {
    let room = room(&QueryConfig::default());
    let mut snapshot = (*room.snapshot).clone();
    let keyframe = KeyframeInfo {
        frame: snapshot.trajectory[0],
        intrinsics: CAMERA,
        rgb: Arc::default(),
        has_language: true,
    };
    snapshot.keyframes = Arc::new(vec![keyframe]);
    let snapshot = Arc::new(snapshot);
    let gpu = Gpu::new(None).expect("a Vulkan adapter");
    let found = wait(mesh(gpu.clone(), snapshot.clone(), 0.03)).expect("a mesh");
    assert!(found.faces.len() > 200, "{} triangles", found.faces.len());
    assert!(found.positions.iter().all(|p| (p.z - 2.0).abs() < 0.03), "flat");
    let query = query("sofa", None);
    let codes = found.codes.clone();
    let relevancies =
        wait(room.thread.relevancies(&Client::Server, snapshot.clone(), codes, query))
            .expect("numbers");
    let mean = |left: bool| {
        let side = |(p, r): (&nalgebra::Point3<f32>, &f32)| ((p.x < 0.0) == left).then_some(*r);
        let all: Vec<f32> = found.positions.iter().zip(&relevancies).filter_map(side).collect();
        all.iter().sum::<f32>() / all.len() as f32
    };
    assert!(mean(true) > mean(false) + 0.2, "sofa left {} right {}", mean(true), mean(false));
    let error = wait(mesh(gpu, snapshot, 0.0)).expect_err("the voxel is too small");
    assert_eq!(error.field(), Some("voxel_metres"));
}

#[test]
fn images_show_the_map() {
    let room = room(&QueryConfig::default());
    let (left, right, corner) = (60 * 160 + 44, 60 * 160 + 115, 0);
    let RenderedImage::Rgb { data, width: 160, height: 120 } = room.render(Channel::Color) else {
        panic!("color is RGB of the view's size")
    };
    let pixel = |data: &[u8], at: usize| [data[3 * at], data[3 * at + 1], data[3 * at + 2]];
    assert!(pixel(&data, left)[1] < 80 && pixel(&data, right)[1] > 150);
    assert_eq!(pixel(&data, corner), [0; 3]);
    // The same frame with half the exposure, and the same view without exposure.
    let mut dim = (*room.snapshot).clone();
    let frame = TrackedFrame { exposure: [0.5_f32.ln(), 0.0], ..dim.trajectory[0] };
    dim.trajectory = Arc::new(vec![frame]);
    let shown = |view: View| {
        let request = RenderRequest { view, channel: Channel::Color, size: None };
        match wait(room.thread.render(&Client::Server, Arc::new(dim.clone()), request))
            .expect("it renders")
        {
            RenderedImage::Rgb { data, .. } => i32::from(pixel(&data, right)[1]),
            other => panic!("{other:?}"),
        }
    };
    let bright = i32::from(pixel(&data, right)[1]);
    let of_camera = View::Camera { intrinsics: CAMERA, world_from_camera: Isometry3::identity() };
    assert!((2 * shown(View::Frame(7)) - bright).abs() <= 2 && shown(of_camera) == bright);
    let RenderedImage::Depth { metres, .. } = room.render(Channel::Depth) else { panic!("depth") };
    assert!((metres[left] - 2.0).abs() < 0.01 && metres[corner] == 0.0, "{}", metres[left]);
    let RenderedImage::Rgb { data, .. } = room.render(Channel::Language) else { panic!("RGB") };
    let apart: i32 = pixel(&data, left)
        .iter()
        .zip(pixel(&data, right))
        .map(|(&a, b)| (i32::from(a) - i32::from(b)).abs())
        .sum();
    assert!(apart > 60 && pixel(&data, corner) == [0; 3], "{apart}");
    let request =
        RenderRequest { view: View::Frame(7), channel: Channel::Opacity, size: Some((80, 60)) };
    let small = wait(room.thread.render(&Client::Server, room.snapshot.clone(), request))
        .expect("it renders");
    let RenderedImage::Rgb { data, width: 80, height: 60 } = small else {
        panic!("of the requested size")
    };
    assert!(pixel(&data, 30 * 80 + 22)[0] > 200 && data.len() == 80 * 60 * 3);
}
