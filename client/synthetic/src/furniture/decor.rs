//! Plants, lamps, toys, rugs.

use crate::dice::Dice;
use crate::material::{Texture, glowing, matt, shiny};
use crate::mesh::Grid;
use crate::prints::Print;
use crate::shapes::Builder;
use crate::vector::rgb;
use glam::{Vec3, vec3};

/// A potted plant about `h` high: pot, earth, stems and curved leaves.
pub(crate) fn plant(b: &mut Builder, d: &mut Dice, h: f32) {
    let clay = rgb(d.pick(&[0xb8643c, 0xd8d4c8, 0x3c5a6a, 0x8a8074]));
    let (r, pot) = (0.15, 0.3);
    let glaze = Texture::Glaze { base: clay, band: clay * 0.5, kind: d.variant() };
    b.lathe(
        Vec3::ZERO,
        &[(0.0, 0.0), (r * 0.7, 0.0), (r, pot - 0.04), (r + 0.012, pot - 0.035), (r + 0.012, pot)],
        shiny(glaze, 0.2),
    );
    b.lathe(
        Vec3::ZERO,
        &[(r + 0.012, pot), (r - 0.005, pot), (r - 0.01, pot - 0.04), (0.0, pot - 0.03)],
        matt(Texture::Carpet { a: rgb(0x3a2618), b: rgb(0x1c120a) }),
    );
    let green = rgb(d.pick(&[0x3f7a34, 0x5a8a3a, 0x2e6a44]));
    let leaf = shiny(Texture::Leaf { a: green, b: green.lerp(rgb(0xd8e0a0), 0.45) }, 0.15);
    let (broad, count) = if d.chance(0.5) { (0.13, 26) } else { (0.065, 40) };
    let grid = Grid { light: [2, 4], ..Grid::even(2, 6, [broad, 0.4]) };
    for i in 0..count {
        let turn = i as f32 * 2.4;
        let (s, c) = turn.sin_cos();
        let rise = (i as f32 + 0.5) / count as f32;
        let length = (h - pot) * (0.75 - 0.35 * rise) * d.between(0.85, 1.1);
        let lift = 0.25 + 1.05 * rise;
        let root = vec3(c * 0.03, s * 0.03, pot - 0.03 + rise * (h - pot) * 0.45);
        b.sheet(&grid, leaf, |u, t| {
            // An arch that leaves upwards and bends over, widest in its middle third.
            let out = length * t * (0.75 - 0.2 * lift) * 0.8;
            let up = length * (lift * t - 0.75 * t * t);
            let width = broad * (t * (1.0 - t) * 4.0).max(0.0).sqrt() * (1.1 - 0.4 * t) + 0.004;
            let side = (u - 0.5) * width;
            let fold = (u - 0.5).abs() * width * 0.5;
            root + vec3(c * out - s * side, s * out + c * side, up + fold)
        });
    }
    b.tube(
        &[vec3(0.0, 0.0, pot - 0.04), vec3(0.0, 0.0, pot + (h - pot) * 0.5)],
        0.016,
        matt(Texture::Plain(rgb(0x5a4a28))),
    );
}

/// A floor lamp `h` high with a fabric shade.
pub(crate) fn floor_lamp(b: &mut Builder, d: &mut Dice, h: f32) {
    let metal = shiny(Texture::Metal(rgb(d.pick(&[0xb89050, 0x2c2c30, 0xb8bcc0]))), 0.5);
    b.lathe(
        Vec3::ZERO,
        &[(0.0, 0.0), (0.14, 0.0), (0.14, 0.018), (0.02, 0.03), (0.012, 0.05)],
        metal,
    );
    b.tube(&[vec3(0.0, 0.0, 0.03), vec3(0.0, 0.0, h - 0.14)], 0.012, metal);
    let (low, high) = (d.between(0.17, 0.21), d.between(0.1, 0.15));
    shade(b, d, vec3(0.0, 0.0, h - 0.3), [low, high, 0.3]);
}

/// A table lamp 0.45 m high with a ceramic foot.
pub(crate) fn table_lamp(b: &mut Builder, d: &mut Dice) {
    let glaze =
        shiny(Texture::Glaze { base: d.bright(), band: rgb(0xf0ebe0), kind: d.variant() }, 0.5);
    b.lathe(
        Vec3::ZERO,
        &[
            (0.0, 0.0),
            (0.06, 0.0),
            (0.06, 0.012),
            (0.03, 0.03),
            (0.065, 0.1),
            (0.05, 0.17),
            (0.015, 0.22),
            (0.01, 0.27),
        ],
        glaze,
    );
    shade(b, d, vec3(0.0, 0.0, 0.24), [0.15, 0.09, 0.2]);
}

/// A lamp shade [lower radius, upper radius, height] standing on `base`, lit from inside.
fn shade(b: &mut Builder, d: &mut Dice, base: Vec3, [low, high, h]: [f32; 3]) {
    let cloth = rgb(d.pick(&[0xf4e4c0, 0xf0d8b0, 0xe8c898, 0xf4ece0]));
    b.lathe(base, &[(low, 0.0), (high, h)], glowing(Texture::Plain(cloth), 0.75));
    b.ball(
        base + vec3(0.0, 0.0, h * 0.45),
        vec3(0.035, 0.035, 0.045),
        glowing(Texture::Plain(rgb(0xfff4dc)), 1.6),
    );
}

/// A lamp hanging from z = 0 downwards by `drop` metres.
pub(crate) fn pendant(b: &mut Builder, d: &mut Dice, drop: f32) {
    let dark = matt(Texture::Plain(rgb(0x202022)));
    b.tube(&[vec3(0.0, 0.0, 0.0), vec3(0.0, 0.0, 0.2 - drop)], 0.006, dark);
    b.cylinder(vec3(0.0, 0.0, -0.03), 0.05, 0.03, dark);
    let mut skin = shiny(Texture::Metal(d.bright()), 0.4);
    skin.glow = 0.12;
    let base = vec3(0.0, 0.0, -drop);
    b.lathe(base, &[(0.2, 0.0), (0.19, 0.05), (0.13, 0.13), (0.05, 0.19), (0.02, 0.21)], skin);
    b.ball(
        base + vec3(0.0, 0.0, 0.05),
        vec3(0.06, 0.06, 0.06),
        glowing(Texture::Plain(rgb(0xfff4dc)), 1.8),
    );
}

/// A ball of the given radius.
pub(crate) fn ball(b: &mut Builder, d: &mut Dice, radius: f32) {
    let skin = match d.count(0, 2) {
        1 => Texture::Toy { a: rgb(0xd0702c), b: rgb(0x000000), radius, kind: 1 },
        kind => Texture::Toy { a: d.bright(), b: d.bright(), radius, kind: kind as u32 },
    };
    b.ball(vec3(0.0, 0.0, radius), vec3(radius, radius, radius), shiny(skin, 0.3));
}

/// A sitting teddy bear 0.36 m high.
pub(crate) fn teddy(b: &mut Builder, d: &mut Dice) {
    let tone = rgb(d.pick(&[0x9a6a3a, 0xc89860, 0x6a4428]));
    let fur = matt(Texture::Carpet { a: tone, b: tone * 0.55 });
    let pale = matt(Texture::Carpet { a: rgb(0xe8d0a0), b: rgb(0xc8a878) });
    let dark = shiny(Texture::Plain(rgb(0x101010)), 0.6);
    b.ball(vec3(0.0, 0.0, 0.11), vec3(0.09, 0.075, 0.11), fur);
    b.ball(vec3(0.0, 0.03, 0.11), vec3(0.06, 0.055, 0.075), pale);
    b.ball(vec3(0.0, 0.01, 0.265), vec3(0.08, 0.072, 0.075), fur);
    b.ball(vec3(0.0, 0.072, 0.25), vec3(0.036, 0.03, 0.028), pale);
    b.ball(vec3(0.0, 0.1, 0.258), vec3(0.011, 0.008, 0.009), dark);
    for side in [-1.0, 1.0] {
        b.ball(vec3(side * 0.063, 0.0, 0.33), vec3(0.03, 0.016, 0.03), fur);
        b.ball(vec3(side * 0.03, 0.075, 0.285), vec3(0.009, 0.006, 0.01), dark);
        b.ball(vec3(side * 0.1, 0.04, 0.15), vec3(0.032, 0.055, 0.035), fur);
        b.ball(vec3(side * 0.065, 0.12, 0.045), vec3(0.04, 0.075, 0.04), fur);
        b.ball(vec3(side * 0.065, 0.185, 0.05), vec3(0.032, 0.014, 0.036), pale);
    }
}

/// A rug `w` × `depth`, 1 cm thick.
pub(crate) fn rug(b: &mut Builder, d: &mut Dice, w: f32, depth: f32) {
    let colors = [d.fabric_color(), d.bright() * 0.8, rgb(0xe8dcc0)];
    let print = matt(Texture::Printed(Print::Rug { colors, seed: d.variant() }));
    b.slab(vec3(0.0, 0.0, 0.005), vec3(w, depth, 0.01), 0.0, matt(Texture::Plain(colors[1])));
    b.plane(
        [vec3(-w / 2.0, -depth / 2.0, 0.0105), vec3(w, 0.0, 0.0), vec3(0.0, depth, 0.0)],
        0.05,
        print,
    );
    for side in [-1.0_f32, 1.0] {
        let fringe = matt(Texture::Stripes { a: rgb(0xe8dcc0), b: rgb(0x9a8a6c), period: 0.02 });
        let x = side * w / 2.0;
        b.panel(
            vec3(x, depth / 2.0, 0.004),
            vec3(0.0, -depth, 0.0),
            vec3(side * 0.05, 0.0, -0.002),
            fringe,
        );
    }
}

/// Radius of the ring a plant of height `h` takes up on the floor.
pub(crate) fn plant_radius(h: f32) -> f32 {
    ((h - 0.3) * 0.45).clamp(0.2, 0.36)
}
