//! Reference, not for production: residuals, Jacobians and normal systems in f64, pixel by pixel.

use nalgebra::{SVector, Vector3};

use crate::oracle::pyramid::{HostLevel, ray};
use lexsplat_gpu::align::{AlignSettings, Estimate, NormalSystem, Robust};
use lexsplat_gpu::shader::layout::{FAR, GATE_SIGMAS, NEAR};

/// A residual and its derivative by [rho, theta, a, b].
#[derive(Clone, Copy, Debug)]
pub struct Residual {
    /// Intensity or metres.
    pub value: f64,
    /// Its derivative.
    pub jacobian: SVector<f64, 8>,
}

/// What one live pixel says.
#[derive(Clone, Copy, Debug, Default)]
pub struct PixelResiduals {
    /// It has a depth.
    pub live: bool,
    /// It is seen inside the reference image.
    pub inside: bool,
    /// It is on a surface that the reference shows too.
    pub visible: bool,
    /// And agrees with the reference in depth.
    pub meets: bool,
    /// And in intensity too.
    pub agrees: bool,
    /// Photometric residual, if it was accepted.
    pub photometric: Option<Residual>,
    /// Geometric residual, if it was accepted.
    pub geometric: Option<Residual>,
    /// Depth of the point in the reference camera, metres.
    pub depth: f64,
}

/// The residuals of one live pixel, counted row by row.
pub fn pixel(
    (reference, live): (&HostLevel, &HostLevel),
    estimate: &Estimate,
    settings: &AlignSettings,
    pixel: usize,
) -> PixelResiduals {
    let width = live.camera.width as usize;
    let [intensity, depth, ..] = live.rows[pixel];
    if !(depth > 0.0 && depth < f64::from(FAR)) {
        return PixelResiduals::default();
    }
    let mut seen = PixelResiduals { live: true, ..PixelResiduals::default() };
    let (u, v) = ((pixel % width) as f64, (pixel / width) as f64);
    let p = ray(&live.camera, u, v) * depth;
    let pose = &estimate.reference_from_live;
    let q = pose.rotation * p + pose.translation.vector;
    if q.z <= f64::from(NEAR) {
        return seen;
    }
    let camera = &reference.camera;
    let focal = [f64::from(camera.fx), f64::from(camera.fy)];
    let at =
        [focal[0] * q.x / q.z + f64::from(camera.cx), focal[1] * q.y / q.z + f64::from(camera.cy)];
    let size = [camera.width as usize, camera.height as usize];
    if !(0..2).all(|i| at[i] >= 0.0 && at[i] <= (size[i] - 1) as f64) {
        return seen;
    }
    (seen.inside, seen.depth) = (true, q.z);
    let corner = [0, 1].map(|i| (at[i] as usize).min(size[i] - 2));
    let part = [0, 1].map(|i| at[i] - corner[i] as f64);
    let tap = |i: usize, j: usize| reference.rows[(corner[1] + j) * size[0] + corner[0] + i];
    let nearest = [0, 1].map(|i| corner[i] + usize::from(part[i] >= 0.5));
    let surface = nearest[1] * size[0] + nearest[0];
    let there = reference.rows[surface][1];
    let normal = |row: [f64; 4]| Vector3::new(row[0], row[1], row[2]);
    let (n, own) = (normal(reference.normals[surface]), normal(live.normals[pixel]));
    let anchor = ray(camera, nearest[0] as f64, nearest[1] as f64) * there;
    let off = n.dot(&(q - anchor));
    let noise = settings.depth_noise * q.z.powi(2);
    let gate = settings.depth_gate + f64::from(GATE_SIGMAS) * noise;
    let same = there > 0.0
        && n != Vector3::zeros()
        && off.abs() <= gate
        && n.dot(&(pose.rotation * own)) >= settings.normal_gate;

    let taps = [tap(0, 0), tap(1, 0), tap(0, 1), tap(1, 1)];
    let mixed = |i: usize| {
        let [a, b, c, d] = taps.map(|tap| tap[i]);
        (1.0 - part[1]) * (a + part[0] * (b - a)) + part[1] * (c + part[0] * (d - c))
    };
    let bright = taps.iter().all(|tap| tap[0] >= 0.0) && intensity >= 0.0;
    seen.visible = there > 0.0 && n != Vector3::zeros() && own != Vector3::zeros() && off >= -gate;
    let change = mixed(0) - estimate.exposure[0].exp() * intensity - estimate.exposure[1];
    let same_color = !bright || change.abs() <= settings.photometric_agreement;
    seen.meets = seen.visible && off <= gate;
    seen.agrees = seen.meets && same_color;
    if bright && same {
        let scaled = [focal[0] * mixed(2) / q.z, focal[1] * mixed(3) / q.z];
        let slope = Vector3::new(scaled[0], scaled[1], -(scaled[0] * q.x + scaled[1] * q.y) / q.z);
        let gain = estimate.exposure[0].exp() * intensity;
        seen.photometric = Some(residual(change, &q, &slope, [-gain, -1.0]));
    }
    if same {
        seen.geometric = Some(residual(off, &q, &n, [0.0; 2]));
    }
    seen
}

/// The normal system over all live pixels that the stride picks.
pub fn system(
    levels: (&HostLevel, &HostLevel),
    estimate: &Estimate,
    settings: &AlignSettings,
) -> NormalSystem {
    system_from(levels, estimate, settings, 0.0)
}

/// The same of one of several comparisons, whose pixels are `phase` of a stride further on.
pub fn system_from(
    levels: (&HostLevel, &HostLevel),
    estimate: &Estimate,
    settings: &AlignSettings,
    phase: f64,
) -> NormalSystem {
    let mut sum = NormalSystem::default();
    for index in picked(levels.1.rows.len(), settings.stride, phase) {
        let seen = pixel(levels, estimate, settings, index);
        sum.counts.live += u32::from(seen.live);
        sum.counts.inside += u32::from(seen.inside);
        sum.counts.visible += u32::from(seen.visible);
        sum.counts.agreeing += u32::from(seen.agrees);
        sum.counts.meeting += u32::from(seen.meets);
        if let Some(residual) = seen.photometric {
            let limits = (settings.photometric_weight, settings.photometric_threshold);
            sum.photometric_cost += add(&mut sum, &residual, limits, Robust::Huber);
            sum.counts.photometric += 1;
            sum.counts.photometric_inliers +=
                u32::from(residual.value.abs() <= settings.photometric_agreement);
        }
        if let Some(residual) = seen.geometric {
            let noise = settings.depth_noise * seen.depth.powi(2);
            let certain =
                settings.geometric_weight / (1.0 + settings.geometric_weight * noise.powi(2));
            let limits = (certain, settings.geometric_threshold);
            sum.geometric_cost += add(&mut sum, &residual, limits, settings.geometric_robust);
            sum.counts.geometric += 1;
            sum.counts.geometric_inliers +=
                u32::from(residual.value.abs() <= settings.geometric_agreement);
        }
    }
    sum
}

/// The live pixels that a stride picks of `pixels`: one of each run of that length.
/// `phase`: how much of the run the picked one is further on.
pub fn picked(pixels: usize, stride: u32, phase: f64) -> impl Iterator<Item = usize> {
    let phase = (phase * 65536.0) as u32;
    (0..pixels as u32 / stride).map(move |i| {
        let place = ((i.wrapping_mul(2_654_435_769) >> 16) + phase) % 65536;
        let shift = (place * stride) >> 16;
        (i * stride + shift) as usize
    })
}

/// Weight rho'(r)/r and cost rho(r).
pub fn robust(kind: Robust, value: f64, threshold: f64) -> (f64, f64) {
    let size = value.abs();
    match kind {
        Robust::Huber if size <= threshold => (1.0, 0.5 * size * size),
        Robust::Huber => (threshold / size, threshold * (size - 0.5 * threshold)),
        Robust::Cauchy => {
            let growth = 1.0 + (size / threshold).powi(2);
            (1.0 / growth, 0.5 * threshold * threshold * growth.ln())
        }
    }
}

fn residual(value: f64, q: &Vector3<f64>, slope: &Vector3<f64>, exposure: [f64; 2]) -> Residual {
    let turn = q.cross(slope);
    let jacobian = [slope.x, slope.y, slope.z, turn.x, turn.y, turn.z, exposure[0], exposure[1]];
    Residual { value, jacobian: SVector::from(jacobian) }
}

fn add(
    sum: &mut NormalSystem,
    residual: &Residual,
    (term, threshold): (f64, f64),
    kind: Robust,
) -> f64 {
    let (weight, cost) = robust(kind, residual.value, threshold);
    let j = &residual.jacobian;
    sum.h += term * weight * j * j.transpose();
    sum.g += term * weight * residual.value * j;
    term * cost
}
