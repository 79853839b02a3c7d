//! Bookcases with their books, cabinets, the television on its stand, bins and boxes.

use crate::dice::Dice;
use crate::material::{Material, Texture, matt, shiny};
use crate::prints::Print;
use crate::shapes::Builder;
use crate::vector::{Placement, rgb};
use glam::{Vec3, vec3};

/// A bookcase `w` wide, `h` high and 0.3 m deep. The books of a shelf are one object.
pub(crate) fn bookcase(b: &mut Builder, d: &mut Dice, w: f32, h: f32) {
    let wood = d.wood();
    let depth = 0.3;
    let board = |axis| shiny(wood.along(axis), 0.15);
    for side in [-1.0, 1.0] {
        b.slab(
            vec3(side * (w / 2.0 - 0.012), 0.0, h / 2.0),
            vec3(0.024, depth, h),
            0.004,
            board(2),
        );
    }
    b.slab(
        vec3(0.0, -depth / 2.0 + 0.008, h / 2.0),
        vec3(w - 0.04, 0.012, h - 0.02),
        0.0,
        board(0),
    );
    let shelves = (h / 0.36) as usize;
    let gap = (h - 0.08) / shelves as f32;
    for i in 0..=shelves {
        let z = 0.06 + i as f32 * gap;
        b.slab(vec3(0.0, 0.0, z), vec3(w - 0.045, depth - 0.01, 0.022), 0.004, board(0));
        if i < shelves && !d.chance(0.08) {
            let place = Placement::upright(vec3(0.0, 0.03, z + 0.011), 0.0);
            b.object("book", place, |b| book_row(b, d, w - 0.07, gap - 0.05));
        }
    }
}

/// Books standing on z = 0 from −x to +x, spines towards +y, none higher than `room`.
fn book_row(b: &mut Builder, d: &mut Dice, w: f32, room: f32) {
    let mut x = -w / 2.0 + d.between(0.0, 0.05);
    let end = w / 2.0 * d.between(0.55, 1.0);
    let mut series = d.bright();
    while x < end - 0.05 {
        let (thick, tall) = (d.between(0.022, 0.055), room * d.between(0.72, 0.97));
        let deep = d.between(0.15, 0.19);
        if d.chance(0.6) {
            series = if d.chance(0.7) { d.bright() } else { d.fabric_color() };
        }
        let cover = matt(Texture::Plaster(series * 0.9));
        b.slab(vec3(x + thick / 2.0, 0.0, tall / 2.0), vec3(thick - 0.002, deep, tall), 0.0, cover);
        let print = Print::Spine { cover: series, seed: d.variant() };
        let (y, width) = (deep / 2.0 + 0.001, thick - 0.003);
        let spine = matt(Texture::Printed(print));
        b.panel(
            vec3(x + thick - 0.0015, y, 0.0),
            vec3(-width, 0.0, 0.0),
            vec3(0.0, 0.0, tall),
            spine,
        );
        let pages = matt(Texture::Printed(Print::Pages));
        let back = vec3(x + 0.003, -deep / 2.0, tall + 0.0005);
        b.panel(back, vec3(width - 0.003, 0.0, 0.0), vec3(0.0, deep - 0.006, 0.0), pages);
        x += thick;
    }
}

/// Doors or drawers with knobs on the front of a carcass.
fn fronts(
    b: &mut Builder,
    body: (f32, f32, f32, f32),
    columns: usize,
    faces: (Material, Material),
) {
    let (w, y, low, high) = body;
    let each = (w - 0.02) / columns as f32;
    for i in 0..columns {
        let x = (i as f32 + 0.5) * each - (w - 0.02) / 2.0;
        let (cz, tall) = ((low + high) / 2.0, high - low);
        b.slab(vec3(x, y + 0.008, cz), vec3(each - 0.012, 0.02, tall - 0.012), 0.006, faces.0);
        b.slab(
            vec3(x, y + 0.014, cz),
            vec3(each - 0.12, 0.018, (tall - 0.12).max(0.04)),
            0.006,
            faces.0,
        );
        let side = if i % 2 == 0 { 1.0 } else { -1.0 };
        let knob = if tall > 0.3 {
            vec3(x + side * (each / 2.0 - 0.035), y + 0.03, cz)
        } else {
            vec3(x, y + 0.036, cz)
        };
        b.ball(knob, vec3(0.014, 0.014, 0.014), faces.1);
    }
}

/// A cabinet `w` × `depth` × `h` with doors below and a drawer row above.
pub(crate) fn cabinet(b: &mut Builder, d: &mut Dice, [w, depth, h]: [f32; 3]) {
    let wood = d.wood();
    let painted = d.chance(0.4).then(|| Texture::Plaster(d.fabric_color()));
    let face = |axis| shiny(painted.unwrap_or(wood.along(axis)), 0.2);
    let knob = shiny(Texture::Metal(rgb(d.pick(&[0xc8a860, 0xb0b4b8, 0x2a2a2c]))), 0.6);
    b.slab(vec3(0.0, 0.0, h / 2.0 + 0.03), vec3(w, depth, h - 0.06), 0.008, face(0));
    b.slab(vec3(0.0, 0.0, h - 0.012), vec3(w + 0.03, depth + 0.03, 0.025), 0.008, face(0));
    b.slab(
        vec3(0.0, -0.02, 0.03),
        vec3(w - 0.06, depth - 0.06, 0.06),
        0.0,
        matt(Texture::Plain(rgb(0x2a2420))),
    );
    let columns = ((w / 0.42) as usize).max(1);
    let split = if h > 1.2 { h - 0.04 } else { h - 0.26 };
    fronts(b, (w, depth / 2.0, 0.09, split), columns, (face(2), knob));
    if h <= 1.2 {
        fronts(b, (w, depth / 2.0, split + 0.01, h - 0.04), columns, (face(0), knob));
    }
}

/// A television `w` wide standing on z = 0, screen towards +y.
pub(crate) fn television(b: &mut Builder, d: &mut Dice, w: f32) {
    let h = w * 0.58;
    let case = shiny(Texture::Plain(rgb(0x121316)), 0.4);
    b.slab(vec3(0.0, 0.0, 0.012), vec3(w * 0.4, 0.2, 0.024), 0.01, case);
    b.slab(vec3(0.0, -0.02, 0.06), vec3(0.08, 0.03, 0.1), 0.01, case);
    b.slab(vec3(0.0, 0.0, 0.08 + h / 2.0), vec3(w, 0.05, h), 0.012, case);
    let mut screen = shiny(Texture::Printed(Print::Broadcast(d.variant())), 0.5);
    screen.glow = 0.6;
    let (sw, sh) = (w - 0.04, h - 0.05);
    b.panel(vec3(sw / 2.0, 0.026, 0.11), vec3(-sw, 0.0, 0.0), vec3(0.0, 0.0, sh), screen);
}

/// A bin 0.3 m high: wicker or painted metal.
pub(crate) fn trash_can(b: &mut Builder, d: &mut Dice) {
    let skin = if d.chance(0.4) {
        matt(Texture::Wicker { a: rgb(0xb08a50), b: rgb(0x8a6434) })
    } else {
        shiny(Texture::Metal(d.bright()), 0.4)
    };
    let (low, high, h) = (0.105, 0.14, d.between(0.3, 0.36));
    b.lathe(Vec3::ZERO, &[(0.0, 0.0), (low, 0.0), (high, h), (high + 0.006, h + 0.008)], skin);
    let dark = matt(Texture::Plain(rgb(0x2a2a2c)));
    let inside = [(high + 0.006, h + 0.008), (high - 0.004, h), (low, 0.02), (0.0, 0.02)];
    b.lathe(Vec3::ZERO, &inside, dark);
    for _ in 0..3 {
        let (x, y) = (d.between(-0.04, 0.04), d.between(-0.04, 0.04));
        let paper = matt(Texture::Weave { a: rgb(0xf0ede4), b: rgb(0xb8b4ac) });
        b.ball(vec3(x, y, h - 0.07), vec3(0.06, 0.05, 0.045), paper);
    }
}

/// A closed cardboard box.
pub(crate) fn carton(b: &mut Builder, d: &mut Dice) {
    let size = vec3(d.between(0.34, 0.45), d.between(0.28, 0.34), d.between(0.24, 0.34));
    b.slab(vec3(0.0, 0.0, size.z / 2.0), size, 0.004, matt(Texture::Printed(Print::Carton)));
    let paper = Print::Label { paper: rgb(0xf0ebe0), ink: rgb(0x202428) };
    let y = size.y / 2.0 + 0.001;
    b.panel(
        vec3(0.08, y, size.z * 0.35),
        vec3(-0.16, 0.0, 0.0),
        vec3(0.0, 0.0, 0.1),
        matt(Texture::Printed(paper)),
    );
}
