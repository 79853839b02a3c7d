//! Printed and displayed surfaces: pictures, book spines, labels, clock faces, rugs, screens, the
//! view from a window. Albedo is linear RGB at a point of the surface (u to the right, v upwards,
//! 0..1).

use crate::noise::{fractal, hash, noise, step};
use crate::surface::SurfacePoint;
use crate::vector::rgb;
use glam::{Vec3, vec3};
use std::f32::consts::TAU;

/// Which print, and its variation.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Print {
    Painting(u32),
    Spine { cover: Vec3, seed: u32 },
    Pages,
    Label { paper: Vec3, ink: Vec3 },
    Clock { face: Vec3, ink: Vec3 },
    Rug { colors: [Vec3; 3], seed: u32 },
    Desktop(u32),
    Keyboard,
    Broadcast(u32),
    Landscape(u32),
    Carton,
}

/// Albedo of a print.
pub(crate) fn albedo(print: Print, at: &SurfacePoint) -> Vec3 {
    let [u, t] = at.uv;
    match print {
        Print::Painting(seed) => painting(u, t, seed),
        Print::Spine { cover, seed } => spine(u, t, cover, seed),
        Print::Pages => vec3(0.72, 0.68, 0.56) * (0.8 + 0.25 * noise(u * 6.0, t * 120.0, 3)),
        Print::Label { paper, ink } => {
            let lines = step(0.3, 0.34, u)
                * (1.0 - step(0.62, 0.66, u))
                * step(0.5, 0.6, ((t * 7.0).rem_euclid(1.0) - 0.5).abs() * 2.0)
                * step(0.35, 0.4, noise(u * 60.0, (t * 7.0).floor(), 4));
            paper.lerp(ink, lines.max(1.0 - step(0.03, 0.05, t)).max(step(0.95, 0.97, t)))
        }
        Print::Clock { face, ink } => clock(u, t, face, ink),
        Print::Rug { colors, seed } => rug(at, colors, seed),
        Print::Desktop(seed) => desktop(u, t, seed),
        Print::Keyboard => {
            let (x, y) = ((u * 13.0).rem_euclid(1.0), (t * 5.0).rem_euclid(1.0));
            let key = step(0.06, 0.12, x.min(1.0 - x)) * step(0.08, 0.16, y.min(1.0 - y));
            vec3(0.35, 0.35, 0.37).lerp(vec3(0.03, 0.03, 0.035), key)
        }
        Print::Broadcast(seed) => broadcast(u, t, seed),
        Print::Landscape(seed) => landscape(u, t, seed),
        Print::Carton => {
            let board =
                rgb(0xb58a5a) * (0.88 + 0.14 * noise(at.metres[0] * 8.0, at.metres[1] * 150.0, 5));
            let tape = 1.0 - step(0.09, 0.1, (u - 0.5).abs());
            board.lerp(rgb(0xd8c08c), tape * 0.8)
        }
    }
}

fn painting(u: f32, t: f32, seed: u32) -> Vec3 {
    let canvas = 0.92 + 0.12 * noise(u * 90.0, t * 90.0, seed);
    let color = match seed % 5 {
        0 => landscape(u, t, seed),
        1 => blocks(u, t, seed),
        2 => still_life(u, t, seed),
        3 => sunset(u, t, seed),
        _ => brushwork(u, t, seed),
    };
    color * canvas
}

/// Sky, two ranges of hills, a meadow.
fn landscape(u: f32, t: f32, seed: u32) -> Vec3 {
    let s = seed as f32;
    let sky = rgb(0xbfdcf2).lerp(rgb(0x4f8fd0), t);
    let cloud = step(0.5, 0.75, fractal(u * 5.0 + s, t * 9.0, seed ^ 5)) * step(0.5, 0.6, t);
    let mut color = sky.lerp(vec3(0.9, 0.9, 0.92), cloud * 0.85);
    for (height, spread, near) in [(0.52, 2.5, rgb(0x6f8fa8)), (0.4, 4.0, rgb(0x4d7a4a))] {
        let ridge = height + 0.16 * (noise(u * spread + s, 0.5, seed ^ 9) - 0.5);
        let shade = 0.8 + 0.4 * noise(u * 20.0, t * 20.0, seed ^ 11);
        color = color.lerp(near * shade, step(0.0, 0.01, ridge - t));
    }
    let meadow = rgb(0x7fa04a).lerp(rgb(0x45692c), noise(u * 30.0, t * 60.0, seed ^ 13));
    color.lerp(meadow, step(0.0, 0.01, 0.24 + 0.04 * (u * 7.0 + s).sin() - t))
}

/// Rectangles of strong color between dark bars.
fn blocks(u: f32, t: f32, seed: u32) -> Vec3 {
    let palette =
        [rgb(0xf2efe6), rgb(0xc8281e), rgb(0x1f4fa0), rgb(0xf0c020), rgb(0xf2efe6), rgb(0x202020)];
    let cut = |x: f32, k: u32| {
        let mut cell = 0;
        let mut edge = x.min(1.0 - x);
        for i in 0..3 {
            let border = (i as f32 + 0.5 + 0.8 * hash(i, 3, seed ^ k)) / 3.8;
            cell += i32::from(x > border);
            edge = edge.min((x - border).abs());
        }
        (cell, edge)
    };
    let ((cx, ex), (cy, ey)) = (cut(u, 17), cut(t, 19));
    let color = palette[(hash(cx, cy, seed) * 5.99) as usize];
    vec3(0.02, 0.02, 0.02).lerp(color, step(0.012, 0.018, ex.min(ey)))
}

/// Fruit on a cloth before a dark ground.
fn still_life(u: f32, t: f32, seed: u32) -> Vec3 {
    let back = rgb(0x4a3a30).lerp(rgb(0x7a6248), fractal(u * 3.0, t * 3.0, seed));
    let mut color = back.lerp(rgb(0xd9cfb8), step(0.0, 0.02, 0.36 - t));
    let fruit = [rgb(0xc0301c), rgb(0xe08a1c), rgb(0x8fa02c), rgb(0xd8b830), rgb(0x6a2c50)];
    for (i, &c) in fruit.iter().enumerate() {
        let (cx, cy) = (0.2 + 0.15 * i as f32, 0.36 + 0.14 * hash(i as i32, 1, seed));
        let r = 0.09 + 0.05 * hash(i as i32, 2, seed);
        let (dx, dy) = (u - cx, t - cy);
        let light = 0.55 + 0.6 * ((dy - dx) / r).clamp(-1.0, 1.0) * 0.5 + 0.3;
        color = color.lerp(c * light, 1.0 - step(r - 0.008, r, dx.hypot(dy)));
    }
    color
}

/// A low sun over water.
fn sunset(u: f32, t: f32, seed: u32) -> Vec3 {
    let sky = rgb(0xf6b04c).lerp(rgb(0x5a3a78), step(0.4, 1.0, t));
    let (sx, sy) = (0.3 + 0.4 * hash(1, 1, seed), 0.52);
    let sun = 1.0 - step(0.08, 0.09, (u - sx).hypot(t - sy));
    let above = sky.lerp(rgb(0xfff0b0), sun);
    let glitter =
        step(0.55, 0.7, noise(u * 12.0, t * 70.0, seed)) * (1.0 - ((u - sx) * 3.0).abs()).max(0.0);
    let water = rgb(0x2c4468).lerp(rgb(0xf4a850), glitter * 0.9);
    water.lerp(above, step(0.42, 0.43, t))
}

/// Sweeps of paint in three colors.
fn brushwork(u: f32, t: f32, seed: u32) -> Vec3 {
    let hue = |k: i32| vec3(hash(k, 1, seed), hash(k, 2, seed), hash(k, 3, seed)) * 0.75;
    let bend = fractal(u * 2.0, t * 2.0, seed) * 3.0;
    let sweep = ((u * 2.0 + t * 3.0 + bend) * 4.0).sin() * 0.5 + 0.5;
    let spots = step(0.6, 0.68, fractal(u * 6.0, t * 6.0, seed ^ 3));
    hue(0).lerp(hue(1), sweep).lerp(hue(2), spots)
}

fn spine(u: f32, t: f32, cover: Vec3, seed: u32) -> Vec3 {
    let gilt = if hash(3, 1, seed) > 0.5 { rgb(0xe0c060) } else { rgb(0xf0ede4) };
    let low = 0.08 + 0.1 * hash(1, 1, seed);
    let bands =
        (1.0 - step(0.012, 0.02, (t - low).abs())).max(1.0 - step(0.012, 0.02, (t - 0.92).abs()));
    // Title: letters as blocks along the spine.
    let letters = step(0.3, 0.36, u)
        * (1.0 - step(0.64, 0.7, u))
        * step(0.35, 0.4, t)
        * (1.0 - step(0.8, 0.82, t))
        * step(0.42, 0.5, noise(t * 46.0, 0.5, seed));
    let worn = cover * (0.82 + 0.25 * noise(u * 4.0, t * 12.0, seed));
    worn.lerp(gilt, bands.max(letters) * 0.9)
}

fn clock(u: f32, t: f32, face: Vec3, ink: Vec3) -> Vec3 {
    let (x, y) = (u - 0.5, t - 0.5);
    let (r, angle) = (x.hypot(y), x.atan2(y));
    let hour = ((angle / TAU * 12.0 + 0.5).rem_euclid(1.0) - 0.5).abs() * r;
    let mark = step(0.36, 0.37, r) * (1.0 - step(0.44, 0.45, r)) * (1.0 - step(0.02, 0.03, hour));
    let hand = |direction: f32, length: f32, width: f32| {
        let (s, c) = direction.sin_cos();
        let (along, across) = (x * s + y * c, x * c - y * s);
        f32::from(along > -0.04 && along < length)
            * (1.0 - step(width, width + 0.008, across.abs()))
    };
    let hands = hand(-1.05, 0.24, 0.016).max(hand(1.05, 0.36, 0.01));
    face.lerp(ink, mark.max(hands).max(1.0 - step(0.02, 0.028, r)))
}

fn rug(at: &SurfacePoint, [ground, border, accent]: [Vec3; 3], seed: u32) -> Vec3 {
    let [u, t] = at.uv;
    let [x, y] = at.metres;
    let (width, height) = (x / u.max(1e-3), y / t.max(1e-3));
    let edge = x.min(width - x).min(y.min(height - y));
    let pile = 0.85 + 0.22 * noise(x * 120.0, y * 120.0, seed);
    let (dx, dy) = (x - width / 2.0, y - height / 2.0);
    let inner = match seed % 3 {
        // A central medallion among small diamonds.
        0 => {
            let medallion = (dx.abs() / width + dy.abs() / height) * 2.0;
            let rings =
                step(0.0, 0.3, (medallion * 16.0).sin()) * (1.0 - step(0.6, 0.62, medallion));
            let (a, b) = ((dx / 0.16).rem_euclid(1.0) - 0.5, (dy / 0.16).rem_euclid(1.0) - 0.5);
            rings.max((1.0 - step(0.2, 0.24, a.abs() + b.abs())) * step(0.62, 0.64, medallion))
        }
        // Broken chevrons.
        1 => {
            let zig = ((x / 0.2).rem_euclid(1.0) - 0.5).abs() * 0.24;
            step(0.46, 0.54, ((y + zig) / 0.14).rem_euclid(1.0))
        }
        _ => step(0.5, 0.62, fractal(x * 5.0, y * 5.0, seed ^ 7)),
    };
    let field = ground.lerp(accent, inner);
    let key = step(0.45, 0.55, ((x + y) / 0.09).rem_euclid(1.0)) * 0.5;
    let frame = border.lerp(accent, key);
    let inside = step(0.12, 0.13, edge);
    let line = step(0.135, 0.14, edge) - step(0.15, 0.155, edge);
    frame.lerp(field, inside).lerp(accent, line) * pile
}

fn desktop(u: f32, t: f32, seed: u32) -> Vec3 {
    let wall = rgb(0x1c4a8c).lerp(rgb(0x56b0d8), (u * 0.6 + t * 0.5).clamp(0.0, 1.0));
    let bar = 1.0 - step(0.07, 0.075, t);
    let mut color = wall.lerp(vec3(0.08, 0.09, 0.11), bar);
    let inside = |x0: f32, x1: f32, y0: f32, y1: f32| u > x0 && u < x1 && t > y0 && t < y1;
    if inside(0.1, 0.62, 0.2, 0.9) {
        let row = (t * 24.0).floor();
        let length = 0.14 + 0.45 * hash(row as i32, 1, seed);
        let text = step(0.35, 0.5, (t * 24.0 - row - 0.5).abs() * -2.0 + 1.0) > 0.5 && u < length;
        color = if t > 0.85 {
            rgb(0x3c3f44)
        } else if text && u > 0.13 {
            rgb(0x3a4a5a)
        } else {
            rgb(0xf4f4f2)
        };
    } else if inside(0.66, 0.93, 0.35, 0.8) {
        let bars = ((u - 0.66) / 0.045).floor();
        let tall = 0.38 + 0.36 * hash(bars as i32, 2, seed);
        color = if t < tall { rgb(0xe07a30) } else { rgb(0x24303c) };
    }
    color
}

fn broadcast(u: f32, t: f32, seed: u32) -> Vec3 {
    let picture = match seed % 3 {
        0 => landscape(u, t, seed),
        1 => sunset(u, t, seed),
        // Switched off: a dark panel with the room's light in it.
        _ => vec3(0.012, 0.013, 0.016)
            .lerp(vec3(0.06, 0.065, 0.075), step(0.4, 1.2, u * 0.6 + t * 0.7)),
    };
    let banner = f32::from(seed.is_multiple_of(3) && t > 0.06 && t < 0.18 && u > 0.05 && u < 0.8);
    picture.lerp(rgb(0xb02020), banner)
}
