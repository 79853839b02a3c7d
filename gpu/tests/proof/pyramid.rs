//! Levels against the oracle, and their cameras.

use crate::room::{Bench, camera, motion, shoot, spoil};

use crate::oracle::pyramid::{self as levels, HostLevel};
use lexsplat_gpu::shader::layout::PixelState;
use lexsplat_gpu::{Buffer, Camera, GpuError, Recorder, pyramid};
use nalgebra::Isometry3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Worst measured 5e-5 (llvmpipe): a packed normal.
const LEVEL_TOLERANCE: f64 = 8e-5;

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
        .fill_rendered(&mut recorder, &found, &buffers.0, &buffers.1)
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
    let refused = bench.pyramids.fill_rendered(&mut recorder, &found, &small, &buffers.1);
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
