//! What a depth camera makes of clean depth: the lag behind color, edges, shadows, holes, noise,
//! steps. In and out: metres, 0 without a measurement.

use super::clean::Clean;
use super::motion::Flow;
use super::noise::{Noise, Purpose};
use super::preset::{Axial, Preset};
use super::surface::{around, coarse, cosines, is_edge};
use std::f32::consts::FRAC_PI_2;

/// Sensors report whole millimetres.
const PER_METRE: f32 = 1000.0;
/// Distance over which a hole's border is smooth, native pixels.
const HOLE_REACH: f32 = 2.0;
/// How much the limits of a hole vary from place to place: cosine, and logarithm of the signal.
const HOLE_COSINE: f32 = 0.03;
const HOLE_SIGNAL: f32 = 0.3;
/// A place is in shadow if what hides it is nearer by this much disparity, pixels.
const SHADOW_PIXELS: f32 = 1.0;

/// Depth as the sensor sends it.
pub(super) fn measured(clean: &Clean, flow: &Flow, preset: &Preset, noise: Noise) -> Vec<f32> {
    let width = clean.width();
    let scale = clean.camera.width as f32 / preset.native_columns as f32;
    let (exact, brightness) = lagged(clean, flow, preset.depth_lag as f32);
    let cosines = cosines(&clean.camera, &exact);
    let mut depth = match preset.grid {
        Some(grid) => coarse(&exact, width, grid),
        None => exact,
    };
    if preset.lateral > 0.0 {
        let reach = preset.lateral_reach * scale;
        depth = jittered(&depth, width, preset.lateral * scale, reach, noise);
    }
    let shadows = shadows(&depth, width, clean.camera.fx as f32 * preset.baseline);
    if preset.flying > 0.0 {
        depth = with_flying(&depth, width, preset.flying, noise);
    }
    let height = clean.height();
    let holes = noise.field(Purpose::Holes, width, height, HOLE_REACH * scale);
    let errors = noise.field(Purpose::Axial, width, height, preset.axial.reach * scale);
    let is_grazing = |cosine: f32, hole: f32| {
        preset.least_cosine > 0.0 && cosine + HOLE_COSINE * hole < preset.least_cosine
    };
    let value = |pixel: usize| {
        let (z, cosine, brightness) = (depth[pixel], cosines[pixel], brightness[pixel]);
        let signal = brightness * cosine / (z * z) * (HOLE_SIGNAL * holes[pixel]).exp();
        let hidden = z <= 0.0
            || shadows[pixel]
            || is_grazing(cosine, holes[pixel])
            || signal < preset.least_signal;
        if hidden {
            return 0.0;
        }
        let deviation = deviation(&preset.axial, z, cosine, brightness);
        // The published deviation includes the steps.
        let step = preset.inverse_step * z * z;
        let rest = (deviation * deviation - step * step / 12.0).max(0.0).sqrt();
        let found = stepped(z + rest * errors[pixel], preset.inverse_step);
        if (preset.near..=preset.far).contains(&found) { found } else { 0.0 }
    };
    (0..depth.len()).map(value).collect()
}

/// Standard deviation of depth at `z` metres.
pub(super) fn deviation(axial: &Axial, z: f32, cosine: f32, brightness: f32) -> f32 {
    // Brightness x cosine for which the figures of `photons` hold.
    const REFERENCE: f32 = 0.5;
    let angle = cosine.clamp(0.05, 1.0).acos();
    let angular = axial.angle * angle * angle / (z.sqrt() * (FRAC_PI_2 - angle).powi(2));
    let sum = axial.floor + axial.linear * z + axial.quadratic * (z - axial.offset).powi(2);
    let photons = (REFERENCE / (brightness * cosine).max(1e-3)).sqrt().clamp(0.7, 4.0);
    (sum + angular) * if axial.photons { photons } else { 1.0 }
}

/// Depth and brightness as the camera sees them `seconds` after the frame.
fn lagged(clean: &Clean, flow: &Flow, seconds: f32) -> (Vec<f32>, Vec<f32>) {
    let width = clean.width();
    let seen = |pixel: usize| {
        let from = flow.nearest(flow.source(pixel % width, pixel / width, seconds));
        let z = clean.depth[from];
        let moved = if z > 0.0 { (z + seconds * flow.approach(from)).max(0.0) } else { 0.0 };
        (moved, clean.brightness(from))
    };
    (0..clean.depth.len()).map(seen).unzip()
}

/// Each pixel looks at a place beside it; only across an edge does it see another depth.
fn jittered(depth: &[f32], width: usize, pixels: f32, reach: f32, noise: Noise) -> Vec<f32> {
    let height = depth.len() / width;
    let columns = noise.field(Purpose::Columns, width, height, reach);
    let rows = noise.field(Purpose::Rows, width, height, reach);
    let place = |at: usize, shift: f32, size: usize| {
        ((at as f32 + pixels * shift).round().max(0.0) as usize).min(size - 1)
    };
    let seen = |pixel: usize| {
        let column = place(pixel % width, columns[pixel], width);
        let row = place(pixel / width, rows[pixel], height);
        let (own, other) = (depth[pixel], depth[row * width + column]);
        if is_edge(own, other) { other } else { own }
    };
    (0..depth.len()).map(seen).collect()
}

/// Some pixels at edges get a depth between both surfaces.
fn with_flying(depth: &[f32], width: usize, share: f32, noise: Noise) -> Vec<f32> {
    let draws = noise.uniform(Purpose::Flying, 2 * depth.len());
    let seen = |pixel: usize| match around(depth, width, pixel) {
        Some([near, far]) if draws[2 * pixel] < share => near + (far - near) * draws[2 * pixel + 1],
        _ => depth[pixel],
    };
    (0..depth.len()).map(seen).collect()
}

/// Which pixels the second eye (to the right of the first) does not see because something nearer is
/// in the way. `disparity` is focal length x baseline, pixels x metres; 0: no second eye.
fn shadows(depth: &[f32], width: usize, disparity: f32) -> Vec<bool> {
    let mut hidden = vec![false; depth.len()];
    if disparity == 0.0 {
        return hidden;
    }
    // Where the second eye sees a pixel of the row, and its disparity.
    let seen = |x: usize, z: f32| (z > 0.0).then(|| (x as f32 - disparity / z, disparity / z));
    for (row, hidden) in depth.chunks_exact(width).zip(hidden.chunks_exact_mut(width)) {
        let mut nearest = vec![0.0_f32; width];
        for (column, d) in row.iter().enumerate().filter_map(|(x, z)| seen(x, *z)) {
            for at in [column.floor(), column.ceil()] {
                if let Some(nearest) =
                    (at >= 0.0).then_some(at as usize).and_then(|at| nearest.get_mut(at))
                {
                    *nearest = nearest.max(d);
                }
            }
        }
        for (x, z) in row.iter().enumerate() {
            let Some((column, d)) = seen(x, *z).filter(|(column, _)| *column >= 0.0) else {
                continue;
            };
            let at = (column.round() as usize).min(width - 1);
            hidden[x] = nearest[at] > d + SHADOW_PIXELS;
        }
    }
    hidden
}

/// The nearest value that the sensor can report.
fn stepped(z: f32, inverse_step: f32) -> f32 {
    if z <= 0.0 {
        return 0.0;
    }
    let mut z = z;
    if inverse_step > 0.0 {
        z = 1.0 / ((1.0 / (z * inverse_step)).round().max(1.0) * inverse_step);
    }
    (z * PER_METRE).round() / PER_METRE
}
