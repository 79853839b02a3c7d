//! Chairs, stools, sofas, beds, and the pillows on them.

use crate::dice::Dice;
use crate::material::{Texture, matt, shiny};
use crate::mesh::Grid;
use crate::shapes::Builder;
use crate::vector::{Placement, rgb};
use glam::{Vec3, vec3};

/// A dining chair about 0.44 m wide and 0.9 m high; all chairs of one `style` look alike.
pub(crate) fn chair(b: &mut Builder, style: u64) {
    let d = &mut Dice::new(style);
    let (w, depth, seat, back) = (0.43, 0.43, 0.46, d.between(0.88, 0.98));
    let wood = d.wood();
    let painted = d.chance(0.3).then(|| Texture::Plaster(d.bright()));
    let frame = |axis| shiny(painted.unwrap_or(wood.along(axis)), 0.25);
    let cushioned = d.chance(0.5);
    let (hx, hy) = (w / 2.0 - 0.025, depth / 2.0 - 0.025);
    for (x, y, top) in [(-hx, hy, seat), (hx, hy, seat), (-hx, -hy, back), (hx, -hy, back)] {
        b.slab(vec3(x, y, top / 2.0), vec3(0.042, 0.042, top), 0.008, frame(2));
    }
    b.slab(vec3(0.0, 0.0, seat - 0.015), vec3(w, depth, 0.035), 0.012, frame(0));
    b.slab(vec3(0.0, hy, seat - 0.07), vec3(w - 0.06, 0.025, 0.06), 0.005, frame(0));
    if cushioned {
        b.slab(
            vec3(0.0, 0.01, seat + 0.025),
            vec3(w - 0.04, depth - 0.05, 0.05),
            0.024,
            matt(d.cloth()),
        );
    }
    if d.chance(0.5) {
        for i in 0..3 {
            let z = seat + 0.14 + i as f32 * 0.13;
            b.slab(vec3(0.0, -hy, z), vec3(w - 0.06, 0.02, 0.07), 0.008, frame(0));
        }
    } else {
        b.slab(vec3(0.0, -hy, back - 0.05), vec3(w - 0.05, 0.024, 0.09), 0.01, frame(0));
        for i in 0..4 {
            let x = (i as f32 - 1.5) * 0.085;
            b.slab(
                vec3(x, -hy, (seat + back) / 2.0),
                vec3(0.022, 0.018, back - seat),
                0.006,
                frame(2),
            );
        }
    }
}

/// A round stool, 0.36 m wide.
pub(crate) fn stool(b: &mut Builder, d: &mut Dice) {
    let wood = d.wood();
    let seat = Texture::Weave { a: d.bright(), b: d.fabric_color() };
    let profile =
        [(0.0, 0.4), (0.17, 0.4), (0.185, 0.42), (0.18, 0.46), (0.14, 0.475), (0.0, 0.478)];
    b.lathe(Vec3::ZERO, &profile, matt(seat));
    for i in 0..4 {
        let (s, c) = (0.785 + i as f32 * std::f32::consts::FRAC_PI_2).sin_cos();
        let foot = vec3(c * 0.18, s * 0.18, 0.0);
        b.tube(&[foot, vec3(c * 0.11, s * 0.11, 0.41)], 0.018, shiny(wood.along(2), 0.2));
    }
}

/// A sofa `w` wide and 0.88 m deep, with its cushions as objects of their own.
pub(crate) fn sofa(b: &mut Builder, d: &mut Dice, w: f32) {
    let cover = d.upholstery();
    let gloss = if matches!(cover, Texture::Leather(_)) { 0.35 } else { 0.0 };
    let cloth = shiny(cover, gloss);
    let seats = if w > 1.7 { 3 } else { 2 };
    let (arm, back) = (0.17, d.between(0.74, 0.86));
    let inner = w - 2.0 * arm;
    b.slab(vec3(0.0, 0.0, 0.2), vec3(w - 0.04, 0.84, 0.24), 0.05, cloth);
    b.slab(vec3(0.0, -0.34, back / 2.0 + 0.06), vec3(w - 0.06, 0.2, back - 0.12), 0.08, cloth);
    for side in [-1.0, 1.0] {
        let x = side * (w - arm) / 2.0;
        b.slab(vec3(x, 0.0, 0.34), vec3(arm, 0.86, 0.5), 0.075, cloth);
        for y in [-0.34, 0.34] {
            b.cylinder(vec3(x, y, 0.0), 0.025, 0.1, shiny(d.wood().along(2), 0.3));
        }
    }
    let each = inner / seats as f32;
    for i in 0..seats {
        let x = (i as f32 + 0.5) * each - inner / 2.0;
        b.slab(vec3(x, 0.06, 0.385), vec3(each - 0.012, 0.68, 0.15), 0.06, cloth);
        b.within(Placement::tilted(vec3(x, -0.2, 0.62), 0.18), |b| {
            b.slab(Vec3::ZERO, vec3(each - 0.02, 0.15, 0.36), 0.07, cloth);
        });
    }
    for side in [-1.0, 1.0] {
        if side < 0.0 || d.chance(0.6) {
            let tilt = Placement::tilted(vec3(side * (inner / 2.0 - 0.23), -0.02, 0.64), 0.35);
            let turned = tilt.then(&Placement::upright(Vec3::ZERO, -side * 0.25));
            b.object("cushion", turned, |b| pillow(b, d, 0.42));
        }
    }
}

/// A square pillow standing on its edge, centred on the origin, facing +y.
fn pillow(b: &mut Builder, d: &mut Dice, size: f32) {
    let cloth = matt(d.cloth());
    let grid = Grid::even(10, 10, [size, size]);
    for side in [-1.0_f32, 1.0] {
        b.sheet(&grid, cloth, |s, t| {
            let (x, z) = ((s - 0.5) * 2.0, (t - 0.5) * 2.0);
            let puff = ((1.0 - x * x).max(0.0) * (1.0 - z * z).max(0.0)).powf(0.45);
            let pinch = 1.0 - 0.07 * (1.0 - x.abs().max(z.abs()).powi(2));
            let half = size / 2.0 * pinch;
            vec3(-side * x * half, side * 0.085 * puff, z * half)
        });
    }
}

/// A bed 2 m long (along y, head at −y), `w` wide, with a pillow as an object of its own.
pub(crate) fn bed(b: &mut Builder, d: &mut Dice, w: f32) {
    let wood = d.wood();
    let length = 1.95;
    let blanket = match d.count(0, 2) {
        0 => Texture::Plaid { ground: d.fabric_color(), band: rgb(0xf0ebe0) },
        1 => Texture::Stripes { a: d.bright(), b: rgb(0xf0ebe0), period: 0.24 },
        _ => Texture::Weave { a: d.fabric_color(), b: d.fabric_color() },
    };
    b.slab(
        vec3(0.0, -length / 2.0, 0.5),
        vec3(w + 0.06, 0.05, 0.9),
        0.02,
        shiny(wood.along(0), 0.2),
    );
    b.slab(
        vec3(0.0, length / 2.0, 0.24),
        vec3(w + 0.06, 0.05, 0.42),
        0.02,
        shiny(wood.along(0), 0.2),
    );
    b.slab(vec3(0.0, 0.0, 0.2), vec3(w, length, 0.14), 0.01, shiny(wood.along(1), 0.2));
    b.slab(
        vec3(0.0, 0.0, 0.36),
        vec3(w - 0.04, length - 0.06, 0.2),
        0.07,
        matt(Texture::Plain(rgb(0xe6e2d8))),
    );
    b.slab(vec3(0.0, 0.28, 0.37), vec3(w + 0.01, length * 0.68, 0.25), 0.06, matt(blanket));
    let pillows = if w > 1.3 { 2 } else { 1 };
    for i in 0..pillows {
        let x = (i as f32 - (pillows - 1) as f32 / 2.0) * w / 2.0;
        let lying = Placement::tilted(vec3(x, -length / 2.0 + 0.3, 0.53), 1.25);
        b.object("cushion", lying, |b| pillow(b, d, 0.5));
    }
}
