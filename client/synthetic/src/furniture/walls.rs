//! Objects in and on walls: doors, windows with curtains, pictures, clocks.

use crate::dice::Dice;
use crate::material::{Material, Texture, matt, shiny};
use crate::mesh::Grid;
use crate::prints::Print;
use crate::shapes::Builder;
use crate::vector::{Placement, rgb};
use glam::{Vec3, vec3};
use std::f32::consts::TAU;

/// Four bars around an opening `w` × `h` centred on the origin.
fn frame(b: &mut Builder, [w, h]: [f32; 2], [bar, thick]: [f32; 2], material: Material) {
    for side in [-1.0, 1.0] {
        let x = side * (w + bar) / 2.0;
        b.slab(vec3(x, thick / 2.0, 0.0), vec3(bar, thick, h + 2.0 * bar), 0.006, material);
        let z = side * (h + bar) / 2.0;
        b.slab(vec3(0.0, thick / 2.0, z), vec3(w, thick, bar), 0.006, material);
    }
}

/// A door 0.9 × 2.03 m, its centre on the origin.
pub(crate) fn door(b: &mut Builder, d: &mut Dice) {
    let (w, h) = (0.9, 2.03);
    let wood = d.wood();
    let painted =
        d.chance(0.4).then(|| Texture::Plaster(rgb(d.pick(&[0xe8e4d8, 0x5a7a80, 0x9a4034]))));
    let face = shiny(painted.unwrap_or(wood.along(2)), 0.2);
    frame(b, [w, h], [0.08, 0.05], shiny(Texture::Plaster(rgb(0xe8e4d8)), 0.1));
    b.slab(vec3(0.0, 0.012, 0.0), vec3(w, 0.03, h), 0.003, face);
    for (z, tall) in [(-0.62, 0.55), (0.08, 0.6), (0.72, 0.42)] {
        for x in [-0.21, 0.21] {
            b.slab(vec3(x, 0.026, z), vec3(0.32, 0.016, tall), 0.008, face);
        }
    }
    let brass = shiny(Texture::Metal(rgb(d.pick(&[0xc8a860, 0xb0b4b8]))), 0.7);
    b.slab(vec3(0.39, 0.03, 0.0), vec3(0.045, 0.012, 0.16), 0.004, brass);
    b.tube(
        &[vec3(0.39, 0.03, 0.02), vec3(0.39, 0.075, 0.02), vec3(0.29, 0.078, 0.02)],
        0.011,
        brass,
    );
}

/// A window `w` × `h` with a landscape outside and curtains, which are objects of their own.
pub(crate) fn window(b: &mut Builder, d: &mut Dice, [w, h]: [f32; 2]) {
    let paint = shiny(Texture::Plaster(rgb(0xeeeae0)), 0.2);
    let mut outside = matt(Texture::Printed(Print::Landscape(d.variant())));
    outside.glow = 1.5;
    b.panel(vec3(w / 2.0, 0.008, -h / 2.0), vec3(-w, 0.0, 0.0), vec3(0.0, 0.0, h), outside);
    frame(b, [w, h], [0.06, 0.05], paint);
    b.slab(vec3(0.0, 0.02, 0.0), vec3(0.045, 0.03, h), 0.004, paint);
    b.slab(vec3(0.0, 0.02, h * 0.18), vec3(w, 0.03, 0.035), 0.004, paint);
    b.slab(vec3(0.0, 0.06, -h / 2.0 - 0.05), vec3(w + 0.2, 0.14, 0.03), 0.01, paint);
    let cloth = matt(d.cloth());
    let drop = h + 0.3;
    let tall = Grid::even(24, 2, [0.45, drop]);
    for side in [-1.0_f32, 1.0] {
        b.object("curtain", Placement::IDENTITY, |b| {
            b.sheet(&tall, cloth, |s, t| {
                let x = side * (w / 2.0 + 0.02) + (0.5 - s) * 0.34;
                vec3(x, 0.1 + 0.025 * (s * TAU * 4.0).sin(), (t - 0.5) * drop + 0.06)
            });
            let rod = matt(Texture::Metal(rgb(0x4a3a2a)));
            let z = drop / 2.0 + 0.065;
            b.tube(&[vec3(side * (w / 2.0 + 0.28), 0.1, z), vec3(0.0, 0.1, z)], 0.014, rod);
        });
    }
}

/// A framed picture `w` × `h`.
pub(crate) fn picture(b: &mut Builder, d: &mut Dice, [w, h]: [f32; 2]) {
    let wood = d.wood();
    let moulding = if d.chance(0.3) { Texture::Metal(rgb(0xc8a050)) } else { wood.along(0) };
    frame(b, [w, h], [0.035, 0.03], shiny(moulding, 0.4));
    let mount = d.chance(0.6);
    b.panel(
        vec3(w / 2.0, 0.006, -h / 2.0),
        vec3(-w, 0.0, 0.0),
        vec3(0.0, 0.0, h),
        matt(Texture::Plain(rgb(0xeeeae0))),
    );
    let k = if mount { 0.8 } else { 1.0 };
    let art = matt(Texture::Printed(Print::Painting(d.variant())));
    b.panel(
        vec3(k * w / 2.0, 0.008, -k * h / 2.0),
        vec3(-k * w, 0.0, 0.0),
        vec3(0.0, 0.0, k * h),
        art,
    );
}

/// A round wall clock 0.34 m wide.
pub(crate) fn clock(b: &mut Builder, d: &mut Dice) {
    let r = 0.17;
    let rim = shiny(Texture::Plain(d.bright() * 0.8), 0.5);
    let n = 32;
    let ring: Vec<Vec3> = (0..=n)
        .map(|i| {
            let (s, c) = (i as f32 / n as f32 * TAU).sin_cos();
            vec3(c * r, 0.022, s * r)
        })
        .collect();
    b.tube(&ring, 0.018, rim);
    let face = Print::Clock { face: rgb(0xf2efe6), ink: rgb(0x1a1a1c) };
    b.within(Placement::upright(vec3(0.0, 0.012, 0.0), 0.0), |b| {
        b.disc(r, matt(Texture::Printed(face)));
    });
}
