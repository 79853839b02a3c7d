//! Reference, not for production: the levels of a pyramid in f64, with plain loops.

use lexsplat_gpu::Camera;
use lexsplat_gpu::shader::layout::{
    DEPTH_AGREEMENT, DEPTH_BEND, LUMA_BLUE, LUMA_GREEN, LUMA_RED, MIN_OPACITY,
};
use nalgebra::Vector3;

/// One image at one size, on the host.
#[derive(Clone, Debug)]
pub struct HostLevel {
    /// Size and intrinsics.
    pub camera: Camera,
    /// Height x width of (intensity or -1, depth in metres or 0, dI/du, dI/dv).
    pub rows: Vec<[f64; 4]>,
    /// Height x width of (unit normal, 1), or 0.
    pub normals: Vec<[f64; 4]>,
}

/// (intensity, depth) of a camera's frame.
pub fn unpack(rgb8: &[u8], depth_metres: &[f32]) -> Vec<[f64; 2]> {
    let grey = |c: &[u8]| luma([c[0], c[1], c[2]].map(|v| f64::from(v) / 255.0));
    rgb8.chunks(3).zip(depth_metres).map(|(c, z)| [grey(c), measured(f64::from(*z))]).collect()
}

/// (intensity, depth) of a rendered view: rows of r, g, b, D and the transmittance of each.
pub fn rendered(image: &[[f64; 4]], transmittance: &[f64]) -> Vec<[f64; 2]> {
    let pixel = |(row, light): (&[f64; 4], &f64)| {
        let opacity = 1.0 - light;
        let grey = luma([row[0], row[1], row[2]]) / opacity;
        if opacity > f64::from(MIN_OPACITY) && grey.is_finite() {
            [grey.max(0.0), measured(row[3] / opacity)]
        } else {
            [-1.0, 0.0]
        }
    };
    image.iter().zip(transmittance).map(pixel).collect()
}

/// The next coarser (intensity, depth).
pub fn halve(fine: &[[f64; 2]], width: usize, height: usize) -> Vec<[f64; 2]> {
    let mut coarse = Vec::new();
    for v in 0..height / 2 {
        for u in 0..width / 2 {
            let first = 2 * (v * width + u);
            let taps = [first, first + 1, first + width, first + width + 1].map(|i| fine[i]);
            let nearest = taps.iter().map(|t| t[1]).filter(|z| *z > 0.0).fold(f64::MAX, f64::min);
            let limit = nearest * (1.0 + f64::from(DEPTH_AGREEMENT));
            coarse.push([
                mean(taps.iter().map(|t| t[0]).filter(|i| *i >= 0.0)).unwrap_or(-1.0),
                mean(taps.iter().map(|t| t[1]).filter(|z| *z > 0.0 && *z <= limit)).unwrap_or(0.0),
            ]);
        }
    }
    coarse
}

/// Slopes and normals of a level.
pub fn finish(camera: &Camera, bases: &[[f64; 2]]) -> HostLevel {
    let (width, height) = (camera.width as i64, camera.height as i64);
    let at = |u: i64, v: i64| {
        let inside = (0..width).contains(&u) && (0..height).contains(&v);
        inside.then(|| bases[(v * width + u) as usize])
    };
    let (mut rows, mut normals) = (Vec::new(), Vec::new());
    for v in 0..height {
        for u in 0..width {
            let here = bases[(v * width + u) as usize];
            let slope = |before: Option<[f64; 2]>, after: Option<[f64; 2]>| {
                let grey = |base: Option<[f64; 2]>| base.map(|b| b[0]).filter(|i| *i >= 0.0);
                match (grey(before), grey(after)) {
                    _ if here[0] < 0.0 => 0.0,
                    (Some(before), Some(after)) => (after - before) / 2.0,
                    (Some(before), None) => here[0] - before,
                    (None, Some(after)) => after - here[0],
                    (None, None) => 0.0,
                }
            };
            let slope_u = slope(at(u - 1, v), at(u + 1, v));
            let slope_v = slope(at(u, v - 1), at(u, v + 1));
            rows.push([here[0], here[1], slope_u, slope_v]);
            normals.push(normal(camera, here[1], |i, j| at(u + i, v + j), (u, v)));
        }
    }
    HostLevel { camera: camera.clone(), rows, normals }
}

fn normal(
    camera: &Camera,
    depth: f64,
    at: impl Fn(i64, i64) -> Option<[f64; 2]>,
    (u, v): (i64, i64),
) -> [f64; 4] {
    let limit = f64::from(DEPTH_AGREEMENT) * depth;
    let point = |i: i64, j: i64| {
        let z = at(i, j)?[1];
        let ray = ray(camera, (u + i) as f64, (v + j) as f64);
        (depth > 0.0 && (z - depth).abs() <= limit).then(|| ray * z)
    };
    let (Some(left), Some(right), Some(up), Some(down)) =
        (point(-1, 0), point(1, 0), point(0, -1), point(0, 1))
    else {
        return [0.0; 4];
    };
    let normal = (down - up).cross(&(right - left));
    let bends = |a: &Vector3<f64>, b: &Vector3<f64>| {
        (a.z + b.z - 2.0 * depth).abs() > f64::from(DEPTH_BEND) * depth
    };
    if normal.norm() > 0.0 && !bends(&left, &right) && !bends(&up, &down) {
        let n = normal.normalize();
        [n.x, n.y, n.z, 1.0]
    } else {
        [0.0; 4]
    }
}

/// The point at depth 1 of a pixel.
pub fn ray(camera: &Camera, u: f64, v: f64) -> Vector3<f64> {
    let x = (u - f64::from(camera.cx)) / f64::from(camera.fx);
    let y = (v - f64::from(camera.cy)) / f64::from(camera.fy);
    Vector3::new(x, y, 1.0)
}

fn mean(values: impl Iterator<Item = f64> + Clone) -> Option<f64> {
    let count = values.clone().count();
    (count > 0).then(|| values.sum::<f64>() / count as f64)
}

fn luma([r, g, b]: [f64; 3]) -> f64 {
    f64::from(LUMA_RED) * r + f64::from(LUMA_GREEN) * g + f64::from(LUMA_BLUE) * b
}

fn measured(depth: f64) -> f64 {
    if depth > 0.0 && depth.is_finite() { depth } else { 0.0 }
}
