//! Duration of the registration of a frame: `cargo bench -p lexsplat-registration`, or `... -- COLUMNS` for
//! another size than 600x340.
//!
//! Color comes through a Brown–Conrady lens, depth from a fisheye of 512x424 pixels 5 cm beside it. The
//! scene is a wavy wall with steps and holes. Each line is the median of [`RUNS`] frames; the first frame,
//! for which the lens is computed, is told apart.

use lexsplat_registration::{
    Camera, Cameras, DepthCamera, Distortion, Intrinsics, Pictures, Registration,
};
use nalgebra::Isometry3;
use std::time::Instant;

const RUNS: usize = 41;

fn main() -> Result<(), lexsplat_registration::LensError> {
    let columns = std::env::args().skip(1).find_map(|word| word.parse().ok()).unwrap_or(600_u32);
    let rows = columns * 17 / 30;
    let (width, height) = (f64::from(columns), f64::from(rows));
    let color = Camera {
        intrinsics: Intrinsics {
            width: columns,
            height: rows,
            fx: 0.55 * width,
            fy: 0.55 * width,
            cx: 0.5 * (width - 1.0),
            cy: 0.5 * (height - 1.0),
        },
        distortion: Distortion::BrownConrady([-0.12, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    };
    let beside = Camera {
        intrinsics: Intrinsics {
            width: 512,
            height: 424,
            fx: 270.0,
            fy: 271.0,
            cx: 254.0,
            cy: 213.0,
        },
        distortion: Distortion::KannalaBrandt([0.03, -0.008, 0.002, 0.0]),
    };
    let depth = DepthCamera::Own {
        camera: beside,
        color_from_depth: Isometry3::translation(-0.05, 0.003, -0.002),
    };
    let straight = Camera { distortion: Distortion::None, ..color };
    println!("{columns}x{rows}, {} threads", rayon::current_num_threads());
    for (name, cameras) in [
        ("color and its depth through one lens", Cameras { color, depth: None }),
        ("depth of a camera beside", Cameras { color: straight, depth: Some(depth) }),
        ("both lenses, two cameras", Cameras { color, depth: Some(depth) }),
    ] {
        measure(name, cameras)?;
    }
    Ok(())
}

fn measure(name: &str, cameras: Cameras) -> Result<(), lexsplat_registration::LensError> {
    let (columns, rows) = cameras.depth_size();
    let depth = (0..columns * rows).map(|pixel| {
        let (column, row) = (pixel % columns, pixel / columns);
        let step = if row % 60 < 20 { 1.0 } else { 0.0 };
        if pixel % 997 < 5 { 0.0 } else { 2.0 + step + 0.3 * (column as f32 * 0.05).sin() }
    });
    let Intrinsics { width, height, .. } = cameras.color.intrinsics;
    let pictures = Pictures {
        intrinsics: cameras.color.intrinsics,
        rgb: (0..width * height * 3).map(|at| (at * 7 % 251) as u8).collect(),
        depth_metres: depth.collect(),
        labels: None,
    };
    let registration = Registration::new(cameras)?;
    let timed = || {
        let started = Instant::now();
        let registered = registration.register(pictures.clone());
        let milliseconds = 1e3 * started.elapsed().as_secs_f64();
        registered.map(|_| milliseconds)
    };
    let first = timed()?;
    let mut others = (0..RUNS).map(|_| timed()).collect::<Result<Vec<_>, _>>()?;
    others.sort_by(f64::total_cmp);
    println!("{name:38} {:6.2} ms, the first {first:6.2} ms", others[RUNS / 2]);
    Ok(())
}
