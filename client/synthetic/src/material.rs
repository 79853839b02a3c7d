//! Materials of surfaces: a texture (albedo), a gloss and a glow. Textures are procedural and
//! depend on the point on the surface and their parameters only. Printed surfaces (pictures,
//! screens, book spines) are in [`crate::prints`].

use crate::noise::{fractal, hash, noise, noise3, step};
use crate::prints::{self, Print};
use crate::surface::SurfacePoint;
use glam::{Vec3, vec3};
use std::f32::consts::{FRAC_PI_3, PI, TAU};

/// Albedo over a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Texture {
    Plain(Vec3),
    /// Painted plaster: the color with a faint unevenness.
    Plaster(Vec3),
    /// Solid wood with its grain along the given object axis.
    Wood {
        base: Vec3,
        dark: Vec3,
        axis: usize,
    },
    /// Floor boards along u.
    Planks {
        base: Vec3,
        dark: Vec3,
    },
    /// Square tiles of the given size in two colors with grout.
    Tiles {
        a: Vec3,
        b: Vec3,
        size: f32,
    },
    Carpet {
        a: Vec3,
        b: Vec3,
    },
    /// Woven cloth: a coarse weave with mottling.
    Weave {
        a: Vec3,
        b: Vec3,
    },
    Plaid {
        ground: Vec3,
        band: Vec3,
    },
    Stripes {
        a: Vec3,
        b: Vec3,
        period: f32,
    },
    Dots {
        ground: Vec3,
        dot: Vec3,
        period: f32,
    },
    Wallpaper {
        ground: Vec3,
        motif: Vec3,
        kind: u32,
    },
    Leather(Vec3),
    Metal(Vec3),
    Wicker {
        a: Vec3,
        b: Vec3,
    },
    /// A leaf with veins; u runs across, v from stem to tip.
    Leaf {
        a: Vec3,
        b: Vec3,
    },
    /// A glazed vessel with a band of ornament; v runs up the profile.
    Glaze {
        base: Vec3,
        band: Vec3,
        kind: u32,
    },
    /// A toy ball in the object's frame, centred at height `radius`.
    Toy {
        a: Vec3,
        b: Vec3,
        radius: f32,
        kind: u32,
    },
    Printed(Print),
}

/// Texture, strength of the highlight (0 matt … 1 mirror-like) and own light (times albedo).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Material {
    pub texture: Texture,
    pub gloss: f32,
    pub glow: f32,
}

/// A matt material.
pub(crate) fn matt(texture: Texture) -> Material {
    Material { texture, gloss: 0.0, glow: 0.0 }
}

/// A shiny material.
pub(crate) fn shiny(texture: Texture, gloss: f32) -> Material {
    Material { texture, gloss, glow: 0.0 }
}

/// A material that gives light of its own; it casts no shadow.
pub(crate) fn glowing(texture: Texture, glow: f32) -> Material {
    Material { texture, gloss: 0.0, glow }
}

impl Material {
    /// Albedo averaged over the surface, for light bounced off it.
    pub fn mean_albedo(&self) -> Vec3 {
        const N: usize = 5;
        let mut sum = Vec3::ZERO;
        for i in 0..N * N {
            let uv = [((i % N) as f32 + 0.5) / N as f32, ((i / N) as f32 + 0.5) / N as f32];
            let local = vec3(uv[0] * 0.7, uv[1] * 0.7, uv[0] * 0.3 + uv[1] * 0.4);
            sum += self.texture.albedo(&SurfacePoint { uv, metres: uv, local });
        }
        sum * (1.0 / (N * N) as f32)
    }
}

impl Texture {
    /// Linear RGB albedo at a place.
    pub fn albedo(&self, at: &SurfacePoint) -> Vec3 {
        let [x, y] = at.metres;
        match *self {
            Texture::Plain(c) => c,
            Texture::Plaster(c) => {
                c * (0.94
                    + 0.07 * fractal(x * 3.0, y * 3.0, 5)
                    + 0.03 * noise(x * 60.0, y * 60.0, 6))
            }
            Texture::Wood { base, dark, axis } => wood(at.local, base, dark, axis),
            Texture::Planks { base, dark } => planks(x, y, base, dark),
            Texture::Tiles { a, b, size } => tiles(x / size, y / size, a, b),
            Texture::Carpet { a, b } => {
                let fleck =
                    noise(x * 90.0, y * 90.0, 11) * 0.6 + fractal(x * 9.0, y * 9.0, 12) * 0.5;
                a.lerp(b, step(0.25, 0.85, fleck))
            }
            Texture::Weave { a, b } => {
                let weave = ((x * 260.0).sin() * (y * 260.0).sin()) * 0.25 + 0.5;
                let mottle = fractal(x * 14.0, y * 14.0, 21);
                a.lerp(b, (0.45 * weave + 0.75 * mottle - 0.15).clamp(0.0, 1.0))
            }
            Texture::Plaid { ground, band } => plaid(x, y, ground, band),
            Texture::Stripes { a, b, period } => {
                let t = (x / period).rem_euclid(1.0);
                let wide = step(0.48, 0.52, t) * (1.0 - step(0.96, 1.0, t));
                a.lerp(b, wide) * (0.93 + 0.1 * noise(x * 70.0, y * 70.0, 31))
            }
            Texture::Dots { ground, dot, period } => {
                let row = (y / period).floor();
                let shift = if row as i32 % 2 == 0 { 0.0 } else { 0.5 };
                let (cx, cy) = ((x / period + shift).rem_euclid(1.0) - 0.5, y / period - row - 0.5);
                ground.lerp(dot, 1.0 - step(0.24, 0.29, cx.hypot(cy)))
            }
            Texture::Wallpaper { ground, motif, kind } => wallpaper(x, y, ground, motif, kind),
            Texture::Leather(c) => {
                c * (0.72
                    + 0.34 * fractal(x * 30.0, y * 30.0, 41)
                    + 0.12 * noise(x * 5.0, y * 5.0, 42))
            }
            Texture::Metal(c) => c * (0.86 + 0.2 * noise(x * 14.0, y * 400.0, 61)),
            Texture::Wicker { a, b } => wicker(x, y, a, b),
            Texture::Leaf { a, b } => leaf(at.uv, a, b),
            Texture::Glaze { base, band, kind } => glaze(at.uv, base, band, kind),
            Texture::Toy { a, b, radius, kind } => toy(at.local, a, b, radius, kind),
            Texture::Printed(print) => prints::albedo(print, at),
        }
    }
}

fn wood(local: Vec3, base: Vec3, dark: Vec3, axis: usize) -> Vec3 {
    let (along, a, b) = (local[axis], local[(axis + 1) % 3] + 0.31, local[(axis + 2) % 3] + 0.17);
    let warp = noise(along * 2.5, a * 9.0 + b * 7.0, 71) * 0.05;
    let rings = ((a + warp).hypot(b * 0.6 + warp) * 190.0).sin() * 0.5 + 0.5;
    let fibre = noise(along * 10.0, a * 260.0 + b * 210.0, 72);
    base.lerp(dark, (0.6 * rings + 0.5 * fibre - 0.05).clamp(0.0, 1.0))
}

fn planks(x: f32, y: f32, base: Vec3, dark: Vec3) -> Vec3 {
    const WIDTH: f32 = 0.14;
    const LENGTH: f32 = 1.3;
    let row = (y / WIDTH).floor();
    let shifted = x / LENGTH + hash(row as i32, 0, 81);
    let board = shifted.floor();
    let tone = hash(row as i32, board as i32, 82);
    let (fx, fy) = ((shifted - board) * LENGTH, y - row * WIDTH);
    let seam = step(0.0, 0.005, fy) * step(0.0, 0.005, fx);
    let offset = tone * 40.0;
    let grain = fractal(x * 4.0 + offset, y * 60.0 + offset, 83);
    let color = base.lerp(dark, (0.55 * grain + 0.5 * tone - 0.1).clamp(0.0, 1.0));
    color * (0.45 + 0.55 * seam)
}

fn tiles(x: f32, y: f32, a: Vec3, b: Vec3) -> Vec3 {
    let (cx, cy) = (x.floor(), y.floor());
    let (fx, fy) = (x - cx, y - cy);
    let edge = fx.min(1.0 - fx).min(fy.min(1.0 - fy));
    let base = if (cx + cy) as i32 % 2 == 0 { a } else { b };
    let tone = 0.88 + 0.12 * hash(cx as i32, cy as i32, 91) + 0.08 * fractal(x * 4.0, y * 4.0, 92);
    vec3(0.42, 0.4, 0.38).lerp(base * tone, step(0.008, 0.022, edge))
}

fn plaid(x: f32, y: f32, ground: Vec3, band: Vec3) -> Vec3 {
    let across = |t: f32| {
        let t = (t / 0.16).rem_euclid(1.0);
        0.45 * (step(0.3, 0.34, t) - step(0.62, 0.66, t))
            + 0.3 * (step(0.8, 0.82, t) - step(0.86, 0.88, t))
    };
    ground.lerp(band, (across(x) + across(y)).clamp(0.0, 1.0))
        * (0.9 + 0.14 * noise(x * 160.0, y * 160.0, 101))
}

fn wallpaper(x: f32, y: f32, ground: Vec3, motif: Vec3, kind: u32) -> Vec3 {
    let paper = 0.96 + 0.05 * fractal(x * 5.0, y * 5.0, 111);
    let amount = match kind % 4 {
        // Pairs of thin vertical stripes.
        0 => {
            let t = (x / 0.22).rem_euclid(1.0);
            (step(0.1, 0.12, t) - step(0.38, 0.4, t)) * 0.8
                + (step(0.46, 0.47, t) - step(0.49, 0.5, t)) * 0.8
        }
        // Ogee damask.
        1 => {
            let (u, w) = (x / 0.32, y / 0.46);
            let ogee = (u * TAU).cos() + (w * TAU).cos() * 0.9;
            let petals = ((u * TAU).sin() * 3.0).cos() * ((w * TAU).sin() * 3.0).cos();
            step(0.05, 0.2, (ogee * petals).abs() - 0.45) * 0.85
        }
        // Sprigs on an offset grid.
        2 => {
            let row = (y / 0.2).floor();
            let shift = if row as i32 % 2 == 0 { 0.0 } else { 0.5 };
            let (dx, dy) = ((x / 0.2 + shift).rem_euclid(1.0) - 0.5, y / 0.2 - row - 0.5);
            let (r, angle) = (dx.hypot(dy), dy.atan2(dx));
            1.0 - step(-0.03, 0.03, r - 0.2 - 0.1 * (angle * 5.0).cos())
        }
        _ => 0.0,
    };
    ground.lerp(motif, amount.clamp(0.0, 1.0)) * paper
}

fn wicker(x: f32, y: f32, a: Vec3, b: Vec3) -> Vec3 {
    let (u, w) = (x / 0.03, y / 0.018);
    let over = (u.floor() + w.floor()) as i32 % 2 == 0;
    let bulge = ((u - u.floor()) * PI).sin() * 0.5 + ((w - w.floor()) * PI).sin() * 0.5;
    let strand = if over { a } else { b };
    strand * (0.35 + 0.65 * bulge) * (0.85 + 0.3 * hash(u as i32, w as i32, 121))
}

fn leaf([u, t]: [f32; 2], a: Vec3, b: Vec3) -> Vec3 {
    let across = (u - 0.5).abs();
    let rib = 1.0 - step(0.015, 0.05, across);
    let veins = (((t - across * 0.9) * 50.0).sin() * 0.5 + 0.5) * 0.35;
    let tone = noise(u * 6.0, t * 9.0, 131) * 0.4;
    a.lerp(b, (rib * 0.7 + veins + tone).clamp(0.0, 1.0))
}

fn glaze([u, t]: [f32; 2], base: Vec3, band: Vec3, kind: u32) -> Vec3 {
    let angle = u * TAU;
    let amount = match kind % 4 {
        0 => step(0.3, 0.32, t) - step(0.42, 0.44, t) + step(0.5, 0.51, t) - step(0.54, 0.55, t),
        1 => {
            let zigzag = 0.5 + 0.1 * ((u * 8.0).rem_euclid(1.0) - 0.5).abs() * 2.0;
            1.0 - step(0.04, 0.06, (t - zigzag).abs())
        }
        // A run of glaze down from the rim.
        2 => step(-0.02, 0.02, t - 0.55 - 0.08 * (angle * 3.0).sin() - 0.05 * (angle * 7.0).cos()),
        _ => 0.0,
    };
    base.lerp(band, amount.clamp(0.0, 1.0)) * (0.9 + 0.12 * noise(u * 30.0, t * 30.0, 141))
}

fn toy(local: Vec3, a: Vec3, b: Vec3, radius: f32, kind: u32) -> Vec3 {
    let d = vec3(local.x, local.y, local.z - radius).normalize_or(Vec3::Z);
    match kind % 3 {
        // Beach ball: six sectors around a tilted axis.
        0 => {
            let sector = ((d.y.atan2(d.x + 0.3 * d.z) / FRAC_PI_3).floor() as i32).rem_euclid(6);
            match sector {
                0 | 3 => a,
                1 | 4 => vec3(0.85, 0.85, 0.82),
                _ => b,
            }
        }
        // Basketball: dark seams on a pebbled ground.
        1 => {
            let seam = d.x.abs().min(d.y.abs()).min((d.x.abs() - 0.62 + 0.35 * d.y * d.y).abs());
            let pebble = 0.85 + 0.3 * noise3(d * 60.0, 151);
            vec3(0.02, 0.02, 0.02).lerp(a * pebble, step(0.018, 0.035, seam))
        }
        // Football: dark patches around the twelve corners of an icosahedron.
        _ => {
            const P: f32 = 1.618;
            let (x, y, z) = (d.x.abs(), d.y.abs(), d.z.abs());
            let corner = (y + P * z).max(x + P * y).max(z + P * x) / 1.902;
            vec3(0.82, 0.82, 0.8).lerp(vec3(0.03, 0.03, 0.04), step(0.93, 0.945, corner))
        }
    }
}
