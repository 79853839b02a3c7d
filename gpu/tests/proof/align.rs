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

#[test]
fn systems_match_the_oracle() {
    let mut bench = Bench::new();
    let mut worst: (f64, u32) = (0.0, 0);
    for (size, stride, robust) in [
        ((40, 30), 1, Robust::Huber),
        ((67, 45), 1, Robust::Cauchy),
        ((67, 45), 7, Robust::Huber),
        ((160, 90), 1, Robust::Huber),
        ((160, 90), 4, Robust::Cauchy),
    ] {
        let (reference, live) = bench.pair(size, 2, 0.1);
        for level in 0..2 {
            let (reference, live) = (&reference.levels()[level], &live.levels()[level]);
            let hosts = (bench.host(reference), bench.host(live));
            let settings =
                AlignSettings { stride, geometric_robust: robust, ..AlignSettings::default() };
            for part in [0.0, 0.6, 1.0] {
                let tau = se3::log(&motion().reference_from_live) * part;
                let exposure = motion().exposure.map(|v| v * part);
                let estimate = Estimate { reference_from_live: se3::exp(&tau), exposure };
                let found =
                    bench.aligner.system(reference, live, &estimate, &settings).expect("sums");
                let wanted = oracle::system((&hosts.0, &hosts.1), &estimate, &settings);
                let off = difference(&found, &wanted);
                println!("{size:?} {stride} {level} {part}: {off:?} {:?}", wanted.counts);
                worst = (worst.0.max(off.0), worst.1.max(off.1));
            }
        }
    }
    println!("worst {worst:?}");
}

#[test]
fn a_known_motion_is_found() {
    let mut bench = Bench::new();
    for outliers in [0.0, 0.1] {
        let (reference, live) = bench.pair((320, 180), 3, outliers);
        let found =
            bench.aligner.align(&reference, &live, &start(), &Schedule::default()).expect("sums");
        println!(
            "{outliers}: {:?} {:?} {} {} {:?}",
            distance(&found.estimate, &motion()),
            found.estimate.exposure,
            found.evaluations,
            found.conditioning,
            found.system.counts
        );
    }
}
