//! Pyramids and alignment: kernels against oracles, Jacobians against differences, known motions
//! found again.

use crate::support;

use lexsplat_gpu::align::oracle::{self, Seen};
use lexsplat_gpu::align::{Prior, Robust, se3};
use lexsplat_gpu::buffer::Buffer;
use lexsplat_gpu::kernel::Recorder;
use lexsplat_gpu::layout::PixelState;
use lexsplat_gpu::pyramid::oracle::{self as levels, HostLevel};
use lexsplat_gpu::pyramid::{self, Level};
use lexsplat_gpu::{
    AlignSettings, Aligner, Camera, Estimate, Gpu, GpuError, NormalSystem, Pyramid, Pyramids,
    Schedule,
};
use nalgebra::{Isometry3, Matrix6, Point3, SVector, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Worst measured 2e-6 (llvmpipe): a normal where central differences are small.
const LEVEL_TOLERANCE: f64 = 1e-4;
/// Worst measured 4e-5 (llvmpipe).
const SYSTEM_TOLERANCE: f64 = 2e-4;

/// A picture of the room below.
struct Frame {
    rgb: Vec<u8>,
    depth: Vec<f32>,
}

fn camera(width: u32, height: u32) -> Camera {
    Camera { camera_from_world: Isometry3::identity(), ..support::camera(width, height) }
}

/// Ray-casts a corner of a room with a ball, all textured, from `room_from_camera`; intensity is
/// scaled by exp(-a) (i - b).
fn shoot(camera: &Camera, room_from_camera: &Isometry3<f64>, [a, b]: [f64; 2]) -> Frame {
    let mut frame = Frame { rgb: Vec::new(), depth: Vec::new() };
    let origin = room_from_camera.translation.vector;
    for v in 0..camera.height {
        for u in 0..camera.width {
            let ray = levels::ray(camera, f64::from(u), f64::from(v));
            let way = room_from_camera.rotation * ray;
            // Walls: n . x = d.
            let walls = [
                (Vector3::new(0.0, 0.0, 1.0), 3.2),
                (Vector3::new(1.0, 0.0, 0.3), 2.1),
                (Vector3::new(0.1, 1.0, 0.2), 1.5),
                (Vector3::new(-1.0, 0.2, 0.4), 2.0),
                (Vector3::new(0.0, -1.0, 0.1), 1.4),
            ];
            let wall = |(n, d): &(Vector3<f64>, f64)| (d - n.dot(&origin)) / n.dot(&way);
            let ball = Vector3::new(-0.3, 0.2, 2.0) - origin;
            let (half, square) = (way.dot(&ball), way.norm_squared());
            let root = half * half - square * (ball.norm_squared() - 0.25);
            let ball = (root > 0.0).then(|| (half - root.sqrt()) / square);
            let z = walls.iter().map(wall).chain(ball).filter(|z| *z > 0.0).fold(9.0, f64::min);
            let x = origin + z * way;
            let grey = texture(&x);
            let tint = [1.1, 1.0, 0.8];
            let shade = |tint: f64| ((grey * tint - b) / a.exp() * 255.0).round() as u8;
            frame.rgb.extend(tint.map(shade));
            frame.depth.push(z as f32);
        }
    }
    frame
}

/// Smooth stripes in space, 0.2 to 0.7.
fn texture(x: &Vector3<f64>) -> f64 {
    let waves = [
        Vector3::new(7.0, 2.0, 3.0),
        Vector3::new(-3.0, 8.0, 1.0),
        Vector3::new(4.0, -2.0, 9.0),
        Vector3::new(15.0, 11.0, -12.0),
    ];
    let sum: f64 = waves.iter().enumerate().map(|(i, w)| (w.dot(x) + i as f64).sin()).sum();
    0.45 + 0.06 * sum
}

/// Drops one depth in ten and replaces one in `outliers`.
fn spoil(frame: &mut Frame, seed: u64, outliers: f64) {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    for pixel in 0..frame.depth.len() {
        let roll: f64 = rng.random();
        if roll < outliers {
            frame.depth[pixel] = rng.random_range(0.5..4.0);
            for channel in 0..3 {
                frame.rgb[3 * pixel + channel] = rng.random();
            }
        } else if roll > 0.9 {
            frame.depth[pixel] = [0.0, f32::NAN, -1.0, f32::INFINITY][pixel % 4];
        }
    }
}

/// 3 cm, 2 degrees and a tenth of exposure.
fn motion() -> Estimate {
    let axis = Vector3::new(1.0, -2.0, 0.5).normalize() * 2f64.to_radians();
    let way = Vector3::new(2.0, 1.0, -2.0).normalize() * 0.03;
    let tau = Vector6::new(way.x, way.y, way.z, axis.x, axis.y, axis.z);
    Estimate { reference_from_live: se3::exp(&tau), exposure: [0.1, 0.02] }
}

fn start() -> Estimate {
    Estimate { reference_from_live: Isometry3::identity(), exposure: [0.0; 2] }
}

/// Metres and radians between two poses.
fn distance(a: &Estimate, b: &Estimate) -> (f64, f64) {
    let off = a.reference_from_live.inverse() * b.reference_from_live;
    (off.translation.vector.norm(), off.rotation.angle())
}

struct Bench {
    gpu: Gpu,
    pyramids: Pyramids,
    aligner: Aligner,
}

impl Bench {
    fn new() -> Self {
        let gpu = support::gpu();
        let pyramids = Pyramids::new(&gpu).expect("compiles");
        let aligner = Aligner::new(&gpu).expect("compiles");
        Self { gpu, pyramids, aligner }
    }

    fn pyramid(&self, camera: &Camera, frame: &Frame, levels: usize) -> Pyramid {
        let mut pyramid = self.pyramids.allocate(camera, levels).expect("fits");
        self.pyramids.fill(&mut pyramid, &frame.rgb, &frame.depth).expect("fits");
        pyramid
    }

    /// Reference at the room's origin and live at [`motion`].
    fn pair(&self, size: (u32, u32), levels: usize, outliers: f64) -> (Pyramid, Pyramid) {
        let camera = camera(size.0, size.1);
        let mut first = shoot(&camera, &Isometry3::identity(), [0.0; 2]);
        let mut second = shoot(&camera, &motion().reference_from_live, motion().exposure);
        if outliers > 0.0 {
            spoil(&mut first, 1, 0.0);
            spoil(&mut second, 2, outliers);
        }
        (self.pyramid(&camera, &first, levels), self.pyramid(&camera, &second, levels))
    }

    fn host(&self, level: &Level) -> HostLevel {
        let pixels = level.camera.pixels();
        let read = |rows: &Buffer<[f32; 4]>| {
            let rows = rows.read(&self.gpu, pixels).expect("reads");
            rows.into_iter().map(|row| row.map(f64::from)).collect()
        };
        HostLevel {
            camera: level.camera.clone(),
            rows: read(&level.rows),
            normals: read(&level.normals),
        }
    }
}

/// Largest difference of two systems: sums relative to the largest of their kind, and counts.
fn difference(found: &NormalSystem, wanted: &NormalSystem) -> (f64, u32) {
    let scale = |i: usize| wanted.h[(i, i)].sqrt().max(1e-9);
    let mut worst: f64 = 0.0;
    for i in 0..8 {
        for j in 0..8 {
            let off = (found.h[(i, j)] - wanted.h[(i, j)]).abs();
            worst = worst.max(off / (scale(i) * scale(j)));
        }
        let off = (found.g[i] - wanted.g[i]).abs();
        worst = worst.max(off / (scale(i) * (2.0 * wanted.cost()).sqrt()));
    }
    let costs = [
        (found.photometric_cost, wanted.photometric_cost),
        (found.geometric_cost, wanted.geometric_cost),
    ];
    for (found, wanted) in costs {
        worst = worst.max((found - wanted).abs() / wanted.max(1e-9));
    }
    let counts = |system: &NormalSystem| {
        let c = system.counts;
        [c.live, c.inside, c.photometric, c.geometric, c.photometric_inliers, c.geometric_inliers]
    };
    let pairs = counts(found).into_iter().zip(counts(wanted));
    (worst, pairs.map(|(found, wanted)| found.abs_diff(wanted)).max().unwrap_or(0))
}

/// Worst differences of two levels: rows and normals.
fn level_difference(found: &HostLevel, wanted: &HostLevel) -> f64 {
    assert_eq!(found.rows.len(), wanted.rows.len());
    let found = found.rows.iter().chain(&found.normals).flatten();
    let wanted = wanted.rows.iter().chain(&wanted.normals).flatten();
    found.zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// The levels of (intensity, depth), by the oracle.
fn oracle_levels(camera: &Camera, bases: Vec<[f64; 2]>, count: usize) -> Vec<HostLevel> {
    let cameras = pyramid::cameras(camera, count).expect("large enough");
    let mut bases = bases;
    let level = |camera: &Camera| {
        let level = levels::finish(camera, &bases);
        bases = levels::halve(&bases, camera.width as usize, camera.height as usize);
        level
    };
    cameras.iter().map(level).collect()
}

#[test]
fn pyramids_of_frames_match_the_oracle() {
    let bench = Bench::new();
    for size in [(16, 16), (67, 45), (131, 77)] {
        let camera = camera(size.0, size.1);
        let mut frame = shoot(&camera, &motion().reference_from_live, [0.0; 2]);
        spoil(&mut frame, 4, 0.02);
        let found = bench.pyramid(&camera, &frame, 3);
        let wanted = oracle_levels(&camera, levels::unpack(&frame.rgb, &frame.depth), 3);
        frame.rgb[3 * 99] ^= 8;
        let other = oracle_levels(&camera, levels::unpack(&frame.rgb, &frame.depth), 3);
        for (level, host) in found.levels().iter().enumerate() {
            let host = bench.host(host);
            let off = level_difference(&host, &wanted[level]);
            println!("{size:?} level {level}: {off:e}");
            assert!(off < LEVEL_TOLERANCE, "{size:?} level {level}: {off}");
            let off = level_difference(&host, &other[level]);
            assert!(off > 1e-4, "a change of 8/255 in one channel must show: {off}");
        }
    }
}

#[test]
fn pyramids_of_renders_match_the_oracle() {
    let bench = Bench::new();
    let camera = camera(50, 37);
    let rng = &mut ChaCha8Rng::seed_from_u64(6);
    let frame = shoot(&camera, &Isometry3::identity(), [0.0; 2]);
    let (mut image, mut states) = (Vec::new(), Vec::new());
    for (pixel, depth) in frame.depth.iter().enumerate() {
        let opacity: f32 = [0.0, 0.3, 0.9, 1.0, rng.random()][rng.random_range(0..5)];
        let rgb = [0, 1, 2].map(|c| f32::from(frame.rgb[3 * pixel + c]) / 255.0 * opacity);
        let nan = pixel == 700;
        image.push([rgb[0], rgb[1], rgb[2], if nan { f32::NAN } else { depth * opacity }]);
        states.push(PixelState { transmittance: 1.0 - opacity, last: 1 });
    }
    let buffers = (
        Buffer::from_slice(&bench.gpu, "image", &image).expect("fits"),
        Buffer::from_slice(&bench.gpu, "states", &states).expect("fits"),
    );
    let found = bench.pyramids.allocate(&camera, 3).expect("fits");
    let mut recorder = Recorder::new(&bench.gpu).expect("fits");
    bench
        .pyramids
        .fill_rendered(&mut recorder, &found, (&buffers.0, &buffers.1))
        .expect("large enough");
    recorder.submit();
    let rows: Vec<_> = image.iter().map(|row| row.map(f64::from)).collect();
    let light: Vec<_> = states.iter().map(|state| f64::from(state.transmittance)).collect();
    let wanted = oracle_levels(&camera, levels::rendered(&rows, &light), 3);
    for (level, wanted) in found.levels().iter().zip(&wanted) {
        let host = bench.host(level);
        let off = level_difference(&host, wanted);
        println!("{}: {off:e}", level.camera.width);
        assert!(off < LEVEL_TOLERANCE, "{off}");
        let empty = HostLevel { normals: vec![[0.0; 4]; host.rows.len()], ..host };
        assert!(level_difference(&empty, wanted) > 0.1, "normals are compared");
    }
    let solid = bench.host(&found.levels()[0]);
    assert!(solid.rows.iter().any(|row| row[0] < 0.0) && solid.rows.iter().any(|row| row[0] > 0.0));
    let small = Buffer::new(&bench.gpu, "small", 7).expect("fits");
    let mut recorder = Recorder::new(&bench.gpu).expect("fits");
    let refused = bench.pyramids.fill_rendered(&mut recorder, &found, (&small, &buffers.1));
    assert!(matches!(refused, Err(GpuError::ShapeMismatch { what: "image", .. })));
}

#[test]
fn levels_keep_the_place_of_pixel_areas() {
    let camera = camera(601, 343);
    let cameras = pyramid::cameras(&camera, 4).expect("large enough");
    let sizes: Vec<_> = cameras.iter().map(|c| (c.width, c.height)).collect();
    assert_eq!(sizes, [(601, 343), (300, 171), (150, 85), (75, 42)]);
    for (level, coarse) in cameras.iter().enumerate() {
        // Pixel (30, 20) covers a block of the finest level; its centre is the block's.
        let side = f32::from(1u16 << level);
        let centre = |i: f32| (i + 0.5) * side - 0.5;
        let point = camera.unproject(centre(30.0), centre(20.0), 1.0);
        let (u, v, _) = coarse.project(&point).expect("in front");
        assert!((u - 30.0).abs() < 1e-3 && (v - 20.0).abs() < 1e-3, "level {level}: {u} {v}");
    }
    let bad = |camera: &Camera, levels| pyramid::cameras(camera, levels).is_err();
    assert!(bad(&camera, 0) && bad(&camera, 8) && bad(&camera, usize::MAX));
    assert!(bad(&Camera { fx: 0.0, ..camera.clone() }, 1));
    assert!(bad(&Camera { cy: f32::NAN, ..camera.clone() }, 1));
    assert!(!bad(&camera, 7));
}

/// Estimates on the way to [`motion`], and beyond.
fn on_the_way(part: f64) -> Estimate {
    let tau = se3::log(&motion().reference_from_live) * part;
    let exposure = motion().exposure.map(|v| v * part);
    Estimate { reference_from_live: se3::exp(&tau), exposure }
}

#[test]
fn systems_match_the_oracle() {
    let mut bench = Bench::new();
    let mut worst: (f64, u32) = (0.0, 0);
    for (size, stride, geometric_robust, normal_gate) in [
        ((40, 30), 1, Robust::Huber, 0.8),
        ((67, 45), 1, Robust::Cauchy, -1.0),
        ((67, 45), 7, Robust::Huber, 0.8),
        ((160, 90), 1, Robust::Huber, 0.8),
        ((161, 91), 4, Robust::Cauchy, 0.9),
    ] {
        let pair = bench.pair(size, 2, 0.1);
        let settings =
            AlignSettings { stride, geometric_robust, normal_gate, ..AlignSettings::default() };
        for (reference, live) in pair.0.levels().iter().zip(pair.1.levels()) {
            let hosts = (bench.host(reference), bench.host(live));
            for part in [0.01, 0.6, 1.0] {
                let estimate = on_the_way(part);
                let found =
                    bench.aligner.system(reference, live, &estimate, &settings).expect("sums");
                let wanted = |estimate| oracle::system((&hosts.0, &hosts.1), estimate, &settings);
                let off = difference(&found, &wanted(&estimate));
                worst = (worst.0.max(off.0), worst.1.max(off.1));
                let (moved, _) = difference(&found, &wanted(&on_the_way(part + 0.01)));
                assert!(moved > 10.0 * SYSTEM_TOLERANCE, "0.3 mm, 0.02 degrees: {moved}");
                let other = AlignSettings { photometric_weight: 1.01e3, ..settings };
                let other = oracle::system((&hosts.0, &hosts.1), &estimate, &other);
                assert!(difference(&found, &other).0 > 10.0 * SYSTEM_TOLERANCE);
            }
        }
    }
    println!("worst {worst:?}");
    assert!(worst.0 < SYSTEM_TOLERANCE && worst.1 == 0, "{worst:?}");
}

#[test]
fn the_same_system_has_the_same_bits() {
    let mut bench = Bench::new();
    let (reference, live) = bench.pair((161, 90), 1, 0.1);
    let mut run = || {
        let levels = (&reference.levels()[0], &live.levels()[0]);
        let settings = AlignSettings::default();
        bench.aligner.system(levels.0, levels.1, &on_the_way(0.5), &settings).expect("sums")
    };
    let first = run();
    assert!((0..5).all(|_| run() == first));
}

/// A reference whose intensity is bilinear in (u, v), so that interpolation and its slopes are
/// exact, before a tilted plane; and a live level that sees the same plane.
fn smooth_pair() -> (HostLevel, HostLevel) {
    let camera = camera(48, 36);
    let mut bases = Vec::new();
    for v in 0..camera.height {
        for u in 0..camera.width {
            let (u, v) = (f64::from(u), f64::from(v));
            let depth = 2.0 / (1.0 + 0.004 * u - 0.003 * v);
            bases.push([0.2 + 0.006 * u + 0.009 * v - 0.0002 * u * v, depth]);
        }
    }
    let level = levels::finish(&camera, &bases);
    (level.clone(), level)
}

#[test]
fn jacobians_are_the_slopes_of_residuals() {
    let (reference, live) = smooth_pair();
    let settings = AlignSettings { depth_gate: 0.5, ..AlignSettings::default() };
    let estimate = on_the_way(0.7);
    let levels = (&reference, &live);
    let residuals = |estimate: &Estimate, pixel: usize| -> Option<[oracle::Residual; 2]> {
        let Seen { photometric, geometric, .. } = oracle::pixel(levels, estimate, &settings, pixel);
        Some([photometric?, geometric?])
    };
    let moved = |axis: usize, by: f64| {
        let mut step = SVector::<f64, 8>::zeros();
        step[axis] = by;
        let tau = Vector6::from_fn(|i, _| step[i]);
        Estimate {
            reference_from_live: se3::exp(&tau) * estimate.reference_from_live,
            exposure: [estimate.exposure[0] + step[6], estimate.exposure[1] + step[7]],
        }
    };
    let (mut worst, mut flipped, mut compared) = (0.0f64, 0.0f64, 0);
    for pixel in (0..reference.rows.len()).step_by(17) {
        let Some(here) = residuals(&estimate, pixel) else { continue };
        for axis in 0..8 {
            let h = 1e-6;
            let around = [moved(axis, h), moved(axis, -h)].map(|e| residuals(&e, pixel));
            let [Some(up), Some(down)] = around else { continue };
            for term in 0..2 {
                let slope = (up[term].value - down[term].value) / (2.0 * h);
                let found = here[term].jacobian[axis];
                worst = worst.max((found - slope).abs());
                flipped = flipped.max((-found - slope).abs());
                compared += 1;
            }
        }
    }
    println!("worst {worst:e} of {compared}");
    assert!(compared > 1000);
    // Measured 2e-9 at slopes of order 1.
    assert!(worst < 1e-7, "{worst}");
    assert!(flipped > 0.5, "a wrong sign must show: {flipped}");
}

#[test]
fn the_gradient_is_that_of_the_cost() {
    let (reference, live) = smooth_pair();
    let estimate = on_the_way(0.7);
    for geometric_robust in [Robust::Huber, Robust::Cauchy] {
        // Thresholds that split the residuals.
        let settings = AlignSettings {
            depth_gate: 0.5,
            photometric_threshold: 0.02,
            geometric_threshold: 0.01,
            geometric_robust,
            ..AlignSettings::default()
        };
        let system = |estimate: &Estimate| oracle::system((&reference, &live), estimate, &settings);
        let here = system(&estimate);
        assert!(here.counts.photometric_inliers < here.counts.photometric);
        assert!(here.counts.geometric_inliers < here.counts.geometric);
        for axis in 0..6 {
            let tau = Vector6::from_fn(|i, _| if i == axis { 1e-7 } else { 0.0 });
            let moved = |tau: Vector6<f64>| {
                let pose = se3::exp(&tau) * estimate.reference_from_live;
                system(&Estimate { reference_from_live: pose, ..estimate })
            };
            let (up, down) = (moved(tau), moved(-tau));
            assert_eq!(up.counts.inside, down.counts.inside, "a smooth point");
            let slope = (up.cost() - down.cost()) / 2e-7;
            let off = (slope - here.g[axis]).abs() / here.g.norm();
            println!("axis {axis}: {off:e}");
            assert!(off < 1e-4, "axis {axis}: {slope} {}", here.g[axis]);
            assert!((slope + here.g[axis]).abs() / here.g.norm() > 1e-3, "a sign must show");
        }
    }
}

#[test]
fn a_known_motion_is_found() {
    let mut bench = Bench::new();
    let settings = AlignSettings { geometric_robust: Robust::Cauchy, ..AlignSettings::default() };
    for (outliers, settings, with_exposure) in [
        (0.0, AlignSettings::default(), true),
        (0.0, settings, true),
        (0.0, AlignSettings { stride: 4, ..settings }, true),
        (0.1, settings, true),
    ] {
        let (reference, live) = bench.pair((320, 180), 3, outliers);
        let schedule = Schedule { settings, with_exposure, ..Schedule::default() };
        let found = bench.aligner.align(&reference, &live, &start(), &schedule).expect("sums");
        let (metres, radians) = distance(&found.estimate, &motion());
        let exposure = found.estimate.exposure;
        println!(
            "{outliers} {}: {metres:.6} m {radians:.6} rad {exposure:.4?}, {} systems, {:.3e}, {:?}",
            settings.stride, found.evaluations, found.conditioning, found.system.counts
        );
    }
}
#[test]
#[ignore = "a measurement, not a test"]
fn align_speed() {
    let mut bench = Bench::new();
    let camera = camera(600, 340);
    let mut frame = shoot(&camera, &Isometry3::identity(), [0.0; 2]);
    spoil(&mut frame, 3, 0.0);
    let mut pyramid = bench.pyramid(&camera, &frame, 3);
    let time = median(&mut || {
        bench.pyramids.fill(&mut pyramid, &frame.rgb, &frame.depth).expect("fits");
        pyramid.levels()[2].normals.read(&bench.gpu, 1).expect("reads");
    });
    println!("pyramid of 3 levels from 600x340: {time:.2?}");
    let time = median(&mut || {
        pyramid.levels()[2].normals.read(&bench.gpu, 1).expect("reads");
    });
    println!("read-back alone: {time:.2?}");
    let (reference, live) = bench.pair((600, 340), 3, 0.0);
    for level in 0..3 {
        for stride in [1, 4, 16] {
            let levels = (&reference.levels()[level], &live.levels()[level]);
            let settings = AlignSettings { stride, ..AlignSettings::default() };
            let mut run = || {
                bench.aligner.system(levels.0, levels.1, &motion(), &settings).expect("sums");
            };
            let time = median(&mut run);
            println!("system at level {level}, stride {stride}: {time:.2?}");
        }
    }
    let time = median(&mut || {
        bench.aligner.align(&reference, &live, &start(), &Schedule::default()).expect("sums");
    });
    println!("align: {time:.2?}");
}

/// Median of 20 after a warm-up.
fn median(run: &mut dyn FnMut()) -> std::time::Duration {
    run();
    let mut times: Vec<_> = (0..20)
        .map(|_| {
            let start = std::time::Instant::now();
            run();
            start.elapsed()
        })
        .collect();
    times.sort();
    print!("[best {:.2?}] ", times[0]);
    times[10]
}
