//! A textured corner of a room, ray-cast, and what tests of pyramids and alignment share.

use crate::support;

use crate::oracle::pyramid::{self as levels, HostLevel};
use lexsplat_gpu::align::se3;
use lexsplat_gpu::pyramid::Level;
use lexsplat_gpu::shader::layout::NO_NORMAL;
use lexsplat_gpu::{Aligner, Buffer, Camera, Estimate, Gpu, Pyramid, Pyramids};
use nalgebra::{Isometry3, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A picture of the room below.
pub struct Frame {
    pub rgb: Vec<u8>,
    pub depth: Vec<f32>,
}

pub fn camera(width: u32, height: u32) -> Camera {
    Camera { camera_from_world: Isometry3::identity(), ..support::camera(width, height) }
}

/// Ray-casts a corner of a room with a ball, all textured, from `room_from_camera`; intensity is
/// scaled by exp(-a) (i - b).
pub fn shoot(camera: &Camera, room_from_camera: &Isometry3<f64>, [a, b]: [f64; 2]) -> Frame {
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
pub fn texture(x: &Vector3<f64>) -> f64 {
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
pub fn spoil(frame: &mut Frame, seed: u64, outliers: f64) {
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
pub fn motion() -> Estimate {
    let axis = Vector3::new(1.0, -2.0, 0.5).normalize() * 2f64.to_radians();
    let way = Vector3::new(2.0, 1.0, -2.0).normalize() * 0.03;
    let tau = Vector6::new(way.x, way.y, way.z, axis.x, axis.y, axis.z);
    Estimate { reference_from_live: se3::exp(&tau), exposure: [0.1, 0.02] }
}

/// Metres and radians between two poses.
pub fn distance(a: &Estimate, b: &Estimate) -> (f64, f64) {
    let off = a.reference_from_live.inverse() * b.reference_from_live;
    (off.translation.vector.norm(), off.rotation.angle())
}

pub struct Bench {
    pub gpu: Gpu,
    pub pyramids: Pyramids,
    pub aligner: Aligner,
}

impl Bench {
    pub fn new() -> Self {
        let gpu = support::gpu();
        let pyramids = Pyramids::new(&gpu).expect("compiles");
        let aligner = Aligner::new(&gpu).expect("compiles");
        Self { gpu, pyramids, aligner }
    }

    pub fn pyramid(&self, camera: &Camera, frame: &Frame, levels: usize) -> Pyramid {
        let mut pyramid = self.pyramids.allocate(camera, levels).expect("fits");
        self.pyramids.fill(&mut pyramid, &frame.rgb, &frame.depth).expect("fits");
        pyramid
    }

    /// Reference at the room's origin and live at [`motion`].
    pub fn pair(&self, size: (u32, u32), levels: usize, outliers: f64) -> (Pyramid, Pyramid) {
        let camera = camera(size.0, size.1);
        let mut first = shoot(&camera, &Isometry3::identity(), [0.0; 2]);
        let mut second = shoot(&camera, &motion().reference_from_live, motion().exposure);
        if outliers > 0.0 {
            spoil(&mut first, 1, 0.0);
            spoil(&mut second, 2, outliers);
        }
        (self.pyramid(&camera, &first, levels), self.pyramid(&camera, &second, levels))
    }

    pub fn host(&self, level: &Level) -> HostLevel {
        let read = |packed: &Buffer<[u32; 2]>| {
            packed.read(&self.gpu, level.camera.pixels()).expect("reads").into_iter()
        };
        let number = |bits: u32| f64::from(f32::from_bits(bits));
        let pixels = read(&level.colors).zip(read(&level.surface));
        let (rows, normals) = pixels
            .map(|([intensity, slopes], [depth, normal])| {
                let [slope_u, slope_v] = halves(slopes);
                ([number(intensity), number(depth), slope_u, slope_v], direction(normal))
            })
            .unzip();
        HostLevel { camera: level.camera.clone(), rows, normals }
    }
}

/// Two numbers from -1 to 1 in 16 bits each.
fn halves(packed: u32) -> [f64; 2] {
    [packed as u16, (packed >> 16) as u16]
        .map(|half| f64::from(half as i16).max(-32767.0) / 32767.0)
}

/// A packed normal and 1, or 0.
fn direction(packed: u32) -> [f64; 4] {
    if packed == NO_NORMAL {
        return [0.0; 4];
    }
    let [x, y] = halves(packed);
    let z = 1.0 - x.abs() - y.abs();
    let [x, y] = if z < 0.0 {
        [(1.0 - y.abs()) * 1f64.copysign(x), (1.0 - x.abs()) * 1f64.copysign(y)]
    } else {
        [x, y]
    };
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length, 1.0]
}
