//! Hashes and value noise for textures: numbers in 0..1 of lattice integers or positions in texture
//! units, the same on every run. Layouts use `ChaCha8` instead.

use glam::Vec3;

/// A hash of three integers, uniform in 0..1.
#[inline(always)]
pub(crate) fn hash(x: i32, y: i32, seed: u32) -> f32 {
    let mut h = (x as u32).wrapping_mul(0x9E37_79B1)
        ^ (y as u32).wrapping_mul(0x85EB_CA77)
        ^ seed.wrapping_mul(0xC2B2_AE3D);
    h ^= h >> 15;
    h = h.wrapping_mul(0x2C1B_3C6D);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297A_2D39);
    h ^= h >> 15;
    (h >> 8) as f32 / 16_777_216.0
}

#[inline(always)]
fn ease(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}

/// Smooth value noise in the plane, 0..1, one lattice cell per unit.
pub(crate) fn noise(x: f32, y: f32, seed: u32) -> f32 {
    let (fx, fy) = (x.floor(), y.floor());
    let (ix, iy) = (fx as i32, fy as i32);
    let (tx, ty) = (ease(x - fx), ease(y - fy));
    let top = hash(ix, iy, seed) * (1.0 - tx) + hash(ix + 1, iy, seed) * tx;
    let bottom = hash(ix, iy + 1, seed) * (1.0 - tx) + hash(ix + 1, iy + 1, seed) * tx;
    top * (1.0 - ty) + bottom * ty
}

/// Smooth value noise in space.
pub(crate) fn noise3(p: Vec3, seed: u32) -> f32 {
    let layer = p.z.floor();
    let t = ease(p.z - layer);
    let at = |k: f32| noise(p.x, p.y, seed ^ (layer + k) as i32 as u32);
    at(0.0) * (1.0 - t) + at(1.0) * t
}

/// Three octaves of plane noise, 0..1.
pub(crate) fn fractal(x: f32, y: f32, seed: u32) -> f32 {
    0.55 * noise(x, y, seed)
        + 0.3 * noise(x * 2.1 + 7.3, y * 2.1, seed ^ 1)
        + 0.15 * noise(x * 4.3, y * 4.3 + 3.1, seed ^ 2)
}

/// 0 below `low`, 1 above `high`, smooth between.
#[inline(always)]
pub(crate) fn step(low: f32, high: f32, x: f32) -> f32 {
    ease(((x - low) / (high - low)).clamp(0.0, 1.0))
}
