//! The table and the objects on it.

use crate::dice::Dice;
use crate::material::{Texture, matt, shiny};
use crate::prints::Print;
use crate::shapes::Builder;
use crate::vector::{Placement, rgb};
use glam::{Vec3, vec3};
use std::f32::consts::{PI, TAU};

/// Height of a table's top, metres.
pub(crate) const TABLE_HEIGHT: f32 = 0.74;

/// A table with a top `w` × `depth`, or round when both are equal.
pub(crate) fn table(b: &mut Builder, d: &mut Dice, w: f32, depth: f32) {
    let wood = d.wood();
    let top = TABLE_HEIGHT;
    let frame = |axis| shiny(wood.along(axis), 0.3);
    if w == depth {
        let r = w / 2.0;
        let plate = [
            (0.0, top - 0.035),
            (r - 0.02, top - 0.035),
            (r, top - 0.018),
            (r - 0.008, top),
            (0.0, top),
        ];
        b.lathe(Vec3::ZERO, &plate, frame(0));
        let foot = [
            (0.28, 0.0),
            (0.28, 0.03),
            (0.1, 0.08),
            (0.055, 0.2),
            (0.05, 0.5),
            (0.12, top - 0.036),
        ];
        b.lathe(Vec3::ZERO, &foot, frame(2));
        return;
    }
    b.slab(vec3(0.0, 0.0, top - 0.02), vec3(w, depth, 0.04), 0.012, frame(0));
    let (hx, hy) = (w / 2.0 - 0.08, depth / 2.0 - 0.08);
    for (x, y) in [(-hx, -hy), (hx, -hy), (-hx, hy), (hx, hy)] {
        b.slab(vec3(x, y, (top - 0.04) / 2.0), vec3(0.065, 0.065, top - 0.04), 0.012, frame(2));
    }
    for side in [-1.0, 1.0] {
        b.slab(vec3(0.0, side * hy, top - 0.085), vec3(2.0 * hx, 0.022, 0.09), 0.004, frame(0));
        b.slab(vec3(side * hx, 0.0, top - 0.085), vec3(0.022, 2.0 * hy, 0.09), 0.004, frame(1));
    }
}

fn ceramic(d: &mut Dice) -> Texture {
    let (base, band) = (d.bright(), rgb(d.pick(&[0xf0ebe0, 0x283c64, 0xe8d8a0, 0x5a2c20])));
    Texture::Glaze { base, band, kind: d.variant() }
}

/// A mug 0.11 m high with a handle.
pub(crate) fn mug(b: &mut Builder, d: &mut Dice) {
    let glaze = shiny(ceramic(d), 0.6);
    let (r, h) = (0.048, 0.11);
    let outside = [(0.0, 0.0), (r - 0.006, 0.0), (r, 0.008), (r, h), (r - 0.004, h + 0.003)];
    b.lathe(Vec3::ZERO, &outside, glaze);
    let inside = [(r - 0.004, h + 0.003), (r - 0.007, h - 0.004), (r - 0.008, 0.02)];
    b.lathe(Vec3::ZERO, &inside, shiny(Texture::Plain(rgb(0xe8e4da)), 0.4));
    let coffee = [(r - 0.008, h * 0.72), (0.0, h * 0.72)];
    b.lathe(Vec3::ZERO, &coffee, shiny(Texture::Plain(rgb(0x3a2010)), 0.5));
    let handle: Vec<Vec3> = (0..=8)
        .map(|i| {
            let (s, c) = (-0.5 * PI + PI * i as f32 / 8.0).sin_cos();
            vec3(r - 0.004 + 0.036 * c, 0.0, h * 0.52 + 0.034 * s)
        })
        .collect();
    b.tube(&handle, 0.0075, glaze);
}

/// A bottle 0.28 to 0.34 m high with a label.
pub(crate) fn bottle(b: &mut Builder, d: &mut Dice) {
    let glass = rgb(d.pick(&[0x1f5a30, 0x2a4a78, 0x5a3010, 0x24707a, 0x8a1c1c]));
    let (r, h) = (d.between(0.036, 0.044), d.between(0.28, 0.34));
    let body = [
        (0.0, 0.0),
        (r - 0.005, 0.0),
        (r, 0.012),
        (r, h * 0.58),
        (r * 0.85, h * 0.66),
        (0.016, h * 0.8),
        (0.0145, h * 0.95),
    ];
    b.lathe(Vec3::ZERO, &body, shiny(Texture::Plain(glass), 0.9));
    let cap = [(0.0145, h * 0.93), (0.017, h * 0.93), (0.017, h), (0.0, h)];
    b.lathe(Vec3::ZERO, &cap, shiny(Texture::Metal(d.bright()), 0.4));
    let (paper, ink) = (rgb(d.pick(&[0xf0ebe0, 0xf0d890, 0xd8e8e0])), d.bright() * 0.6);
    let label = [(r + 0.0008, h * 0.17), (r + 0.0008, h * 0.48)];
    b.lathe(Vec3::ZERO, &label, matt(Texture::Printed(Print::Label { paper, ink })));
}

/// A bowl 0.26 m wide with apples in it; the apples are objects of their own.
pub(crate) fn bowl(b: &mut Builder, d: &mut Dice) {
    let glaze = shiny(ceramic(d), 0.5);
    let outside =
        [(0.0, 0.0), (0.05, 0.0), (0.055, 0.01), (0.1, 0.04), (0.125, 0.085), (0.13, 0.1)];
    b.lathe(Vec3::ZERO, &outside, glaze);
    let inside =
        [(0.13, 0.1), (0.124, 0.098), (0.118, 0.082), (0.094, 0.045), (0.05, 0.018), (0.0, 0.016)];
    b.lathe(Vec3::ZERO, &inside, glaze);
    let skin = rgb(d.pick(&[0xb8281c, 0x8aa828, 0xd8a020]));
    for i in 0..4 {
        let (s, c) = (d.between(0.0, 0.6) + i as f32 * TAU / 3.0).sin_cos();
        let place = if i < 3 { vec3(c * 0.052, s * 0.052, 0.035) } else { vec3(0.0, 0.005, 0.085) };
        b.object("apple", Placement::upright(place, s), |b| apple(b, skin));
    }
}

fn apple(b: &mut Builder, skin: Vec3) {
    let profile = [
        (0.0, 0.004),
        (0.018, 0.0),
        (0.034, 0.014),
        (0.041, 0.038),
        (0.036, 0.062),
        (0.018, 0.072),
        (0.0, 0.062),
    ];
    b.lathe(Vec3::ZERO, &profile, shiny(Texture::Weave { a: skin, b: skin * 0.7 }, 0.4));
    b.tube(
        &[vec3(0.0, 0.0, 0.06), vec3(0.004, 0.002, 0.085)],
        0.003,
        matt(Texture::Plain(rgb(0x4a3018))),
    );
}

/// A vase 0.24 to 0.3 m high with a few flowers.
pub(crate) fn vase(b: &mut Builder, d: &mut Dice) {
    let (h, belly) = (d.between(0.19, 0.24), d.between(0.06, 0.08));
    let neck = belly * d.between(0.4, 0.6);
    let outside = [
        (0.0, 0.0),
        (belly * 0.6, 0.0),
        (belly * 0.85, h * 0.16),
        (belly, h * 0.4),
        (belly * 0.85, h * 0.62),
        (neck, h * 0.84),
        (neck * 1.25, h),
    ];
    b.lathe(Vec3::ZERO, &outside, shiny(ceramic(d), 0.6));
    let inside = [(neck * 1.25, h), (neck * 0.9, h * 0.86), (0.0, h * 0.7)];
    b.lathe(Vec3::ZERO, &inside, matt(Texture::Plain(rgb(0x2a2622))));
    let petals = matt(Texture::Weave { a: d.bright(), b: d.bright() });
    for i in 0..5 {
        let (s, c) = (i as f32 * TAU / 5.0 + 0.4).sin_cos();
        let lean = 0.05 + 0.03 * (i % 2) as f32;
        let tip = vec3(c * lean, s * lean, h + 0.07 + 0.02 * (i % 3) as f32);
        b.tube(&[vec3(0.0, 0.0, h * 0.8), tip], 0.003, matt(Texture::Plain(rgb(0x3c6a2c))));
        b.ball(tip, vec3(0.026, 0.026, 0.018), petals);
        b.ball(
            tip + vec3(0.0, 0.0, 0.012),
            vec3(0.009, 0.009, 0.009),
            matt(Texture::Plain(rgb(0xf0c830))),
        );
    }
}

/// An open laptop 0.34 m wide; the screen faces +y.
pub(crate) fn laptop(b: &mut Builder, d: &mut Dice) {
    let shell = shiny(Texture::Metal(rgb(d.pick(&[0xb4b8bc, 0x3a3d42, 0xd0c8bc]))), 0.4);
    let (w, depth, tall) = (0.34, 0.23, 0.22);
    b.slab(vec3(0.0, 0.0, 0.009), vec3(w, depth, 0.018), 0.006, shell);
    let keys = matt(Texture::Printed(Print::Keyboard));
    // Typed at from +y: the keyboard's right is −x.
    b.panel(vec3(0.15, 0.0, 0.0187), vec3(-0.3, 0.0, 0.0), vec3(0.0, -0.1, 0.0), keys);
    b.panel(
        vec3(0.05, 0.1, 0.0187),
        vec3(-0.1, 0.0, 0.0),
        vec3(0.0, -0.08, 0.0),
        matt(Texture::Plain(rgb(0x85888c))),
    );
    b.within(Placement::tilted(vec3(0.0, -depth / 2.0 + 0.004, 0.018), 0.3), |b| {
        b.slab(vec3(0.0, -0.004, tall / 2.0), vec3(w, 0.009, tall), 0.004, shell);
        let bezel = matt(Texture::Plain(rgb(0x101214)));
        b.panel(
            vec3(0.165, 0.001, 0.006),
            vec3(-0.33, 0.0, 0.0),
            vec3(0.0, 0.0, tall - 0.012),
            bezel,
        );
        let mut picture = matt(Texture::Printed(Print::Desktop(d.variant())));
        picture.glow = 0.75;
        b.panel(
            vec3(0.156, 0.002, 0.016),
            vec3(-0.312, 0.0, 0.0),
            vec3(0.0, 0.0, tall - 0.03),
            picture,
        );
    });
}

/// A stack of lying books, 0.24 m wide; front cover up.
pub(crate) fn books_lying(b: &mut Builder, d: &mut Dice) {
    let mut z = 0.0;
    for _ in 0..d.count(1, 3) {
        let (w, depth, thick) =
            (d.between(0.19, 0.24), d.between(0.14, 0.17), d.between(0.025, 0.045));
        let cover = d.bright();
        let turn = d.between(-0.3, 0.3);
        b.within(Placement::upright(vec3(0.0, 0.0, z), turn), |b| {
            b.slab(
                vec3(0.0, 0.0, thick / 2.0),
                vec3(w, depth, thick),
                0.003,
                matt(Texture::Plaster(cover)),
            );
            let pages = matt(Texture::Printed(Print::Pages));
            let (x, y) = (w / 2.0, depth / 2.0 + 0.001);
            b.panel(
                vec3(x - 0.01, y, 0.004),
                vec3(0.01 - 2.0 * x, 0.0, 0.0),
                vec3(0.0, 0.0, thick - 0.008),
                pages,
            );
            let spine = Print::Spine { cover, seed: d.variant() };
            let print = matt(Texture::Printed(spine));
            b.panel(vec3(-x, -y, 0.0), vec3(0.0, 0.0, thick), vec3(2.0 * x, 0.0, 0.0), print);
            let art = matt(Texture::Printed(Print::Painting(d.variant())));
            let (cx, cy, top) = (w * 0.3, depth * 0.36, thick + 0.001);
            b.panel(vec3(-cx, -cy, top), vec3(2.0 * cx, 0.0, 0.0), vec3(0.0, 2.0 * cy, 0.0), art);
        });
        z += thick + 0.001;
    }
}
