//! The layout of a room: walls, floor and ceiling, a table group in the middle, furniture along the
//! walls, pictures on free walls, toys on the free floor; the lights and the camera's loop. Objects
//! are built by [`crate::furniture`].

use crate::dice::Dice;
use crate::furniture::tables::TABLE_HEIGHT;
use crate::furniture::{decor, seating, storage, tables, walls};
use crate::light::Light;
use crate::material::{Material, Texture, matt, shiny};
use crate::path::Loop;
use crate::places::{Places, Wall};
use crate::shapes::Builder;
use crate::vector::{Placement, rgb};
use glam::{Vec3, vec3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// A furnished room.
pub(crate) struct Furnished {
    pub builder: Builder,
    pub lights: Vec<Light>,
    pub walk: Loop,
}

struct Furnisher {
    b: Builder,
    d: Dice,
    places: Places,
    lights: Vec<Light>,
}

/// Furnishes the room of a seed.
pub(crate) fn furnish(seed: u64) -> Furnished {
    let mut d = Dice::new(seed);
    let size = vec3(d.between(4.6, 5.8), d.between(4.4, 5.2), d.between(2.5, 2.8));
    let places = Places::new(size);
    let mut f = Furnisher { b: Builder::new(), d, places, lights: Vec::new() };
    f.shell();
    f.table_group();
    f.openings();
    f.along_the_walls();
    f.small_things();
    f.hang();
    let radius = |extent: f32| f64::from(extent / 2.0 - 1.1).clamp(0.95, 1.3);
    let walk = Loop::new([0.0, 0.0], [radius(size.x), radius(size.y)], &mut f.d);
    Furnished { builder: f.b, lights: f.lights, walk }
}

const WARM: Vec3 = vec3(1.0, 0.86, 0.66);
const DAY: Vec3 = vec3(0.92, 1.0, 1.12);

impl Furnisher {
    fn shell(&mut self) {
        let (d, size) = (&mut self.d, self.places.size);
        let floor = match d.count(0, 4) {
            0 => Texture::Tiles {
                a: rgb(d.pick(&[0xd8cdb8, 0xb8b4ac, 0xc09070])),
                b: rgb(d.pick(&[0xcfc2aa, 0x8a9094, 0x6a7a70])),
                size: d.pick(&[0.3, 0.4]),
            },
            1 => {
                let a = d.fabric_color();
                Texture::Carpet { a: a.lerp(rgb(0xd8d0c0), 0.5), b: a.lerp(rgb(0x9a9284), 0.5) }
            }
            _ => d.wood().planks(),
        };
        let gloss = if matches!(floor, Texture::Carpet { .. }) { 0.0 } else { 0.2 };
        let (x, y, h) = (size.x / 2.0 + 0.05, size.y / 2.0 + 0.05, size.z);
        self.b.object("floor", Placement::IDENTITY, |b| {
            let along = [vec3(-x, -y, 0.0), vec3(2.0 * x, 0.0, 0.0), vec3(0.0, 2.0 * y, 0.0)];
            b.plane(along, 0.05, shiny(floor, gloss));
        });
        self.b.object("ceiling", Placement::IDENTITY, |b| {
            let along = [vec3(-x, y, h), vec3(2.0 * x, 0.0, 0.0), vec3(0.0, -2.0 * y, 0.0)];
            b.plane(along, 0.12, matt(Texture::Plaster(rgb(0xf2f0ea))));
        });
        let paper = wall_paint(d);
        let accent = if d.chance(0.5) { wall_paint(d) } else { paper };
        for wall in Wall::ALL {
            let skin = if wall == Wall::ALL[2] { accent } else { paper };
            let (length, place) = (self.places.length(wall), self.places.on_wall(wall, 0.0, 0.0));
            self.b.object("wall", place, |b| {
                let half = length / 2.0 + 0.05;
                b.plane(
                    [vec3(half, 0.0, -0.05), vec3(-2.0 * half, 0.0, 0.0), vec3(0.0, 0.0, h + 0.1)],
                    0.08,
                    skin,
                );
                let skirting = shiny(Texture::Plaster(rgb(0xe8e4d8)), 0.1);
                b.slab(vec3(0.0, 0.008, 0.045), vec3(length, 0.016, 0.09), 0.004, skirting);
            });
        }
    }

    /// Table, chairs, rug, the lamp above, and the objects on the table.
    fn table_group(&mut self) {
        let round = self.d.chance(0.3);
        let w = if round { self.d.between(1.05, 1.2) } else { self.d.between(1.3, 1.55) };
        let depth = if round { w } else { self.d.between(0.8, 0.92) };
        let turn = self.d.pick(&[0.0, FRAC_PI_2]) + self.d.between(-0.12, 0.12);
        let centre = vec3(self.d.between(-0.15, 0.15), self.d.between(-0.15, 0.15), 0.0);
        let place = Placement::upright(centre, turn);
        self.places.take(&place, [w, depth], 0.0);
        if self.d.chance(0.85) {
            let (rw, rd) = (w + self.d.between(0.7, 1.0), depth + self.d.between(0.8, 1.1));
            let d = &mut self.d;
            self.b.object("rug", place, |b| decor::rug(b, d, rw, rd));
        }
        let lifted = place.then(&Placement::upright(vec3(0.0, 0.0, 0.011), 0.0));
        let d = &mut self.d;
        self.b.object("table", lifted, |b| tables::table(b, d, w, depth));
        self.chairs(&lifted, [w, depth]);
        self.on_table(&lifted, [w, depth]);
        let drop = self.places.size.z - self.d.between(1.75, 1.9);
        let hook = centre + vec3(0.0, 0.0, self.places.size.z);
        let d = &mut self.d;
        self.b.object("lamp", Placement::upright(hook, 0.0), |b| decor::pendant(b, d, drop));
        self.lights.push(Light::lamp(hook + vec3(0.0, 0.0, 0.05 - drop), 0.1, WARM * 2.6));
    }

    fn chairs(&mut self, table: &Placement, [w, depth]: [f32; 2]) {
        let style = u64::from(self.d.variant());
        let mut seats = vec![(0.0, depth / 2.0, PI), (0.0, -depth / 2.0, 0.0)];
        if w == depth {
            seats = (0..3).map(|i| (i as f32 * TAU / 3.0 + 0.5, w / 2.0, f32::NAN)).collect();
        } else if self.d.chance(0.6) {
            let x = w / 4.0;
            seats = [-x, x]
                .iter()
                .flat_map(|&x| [(x, depth / 2.0, PI), (x, -depth / 2.0, 0.0)])
                .collect();
        }
        if w != depth && self.d.chance(0.4) {
            seats.push((w / 2.0, f32::NAN, FRAC_PI_2));
        }
        for (a, edge, yaw) in seats {
            let out = self.d.between(0.0, 0.2);
            let wobble = self.d.between(-0.2, 0.2);
            let local = if yaw.is_nan() {
                let (s, c) = a.sin_cos();
                Placement::upright(vec3(c, s, 0.0) * (edge + out), a + FRAC_PI_2 + wobble)
            } else if edge.is_nan() {
                Placement::upright(vec3(a + out, 0.0, 0.0), yaw + wobble)
            } else {
                Placement::upright(vec3(a, edge + out * edge.signum(), 0.0), yaw + wobble)
            };
            let place = table.then(&local);
            self.places.take(&place, [0.45, 0.45], 0.0);
            self.b.object("chair", place, |b| seating::chair(b, style));
        }
    }

    fn on_table(&mut self, table: &Placement, [w, depth]: [f32; 2]) {
        type Build = fn(&mut Builder, &mut Dice);
        let all: [(&'static str, f32, f32, Build); 7] = [
            ("laptop", 0.2, 0.8, tables::laptop),
            ("bowl", 0.14, 0.75, tables::bowl),
            ("book", 0.13, 1.0, tables::books_lying),
            ("vase", 0.09, 0.7, tables::vase),
            ("mug", 0.065, 1.0, tables::mug),
            ("bottle", 0.05, 0.9, tables::bottle),
            ("mug", 0.065, 0.4, tables::mug),
        ];
        let mut taken: Vec<(Vec3, f32)> = Vec::new();
        for (class, radius, likely, build) in all {
            if !self.d.chance(likely) {
                continue;
            }
            let free = (0..80).find_map(|_| {
                let (hx, hy) = (w / 2.0 - radius, depth / 2.0 - radius);
                let p =
                    vec3(self.d.between(-hx, hx), self.d.between(-hy, hy), TABLE_HEIGHT + 0.001);
                let inside = w != depth || p.x.hypot(p.y) < hx;
                let clear = |(q, r): &(Vec3, f32)| (p - *q).length() > radius + r + 0.02;
                (inside && taken.iter().all(clear)).then_some(p)
            });
            let Some(p) = free else { continue };
            taken.push((p, radius));
            let yaw = match class {
                "laptop" => (if p.y < 0.0 { PI } else { 0.0 }) + self.d.between(-0.4, 0.4),
                _ => self.d.between(0.0, TAU),
            };
            let d = &mut self.d;
            self.b.object(class, table.then(&Placement::upright(p, yaw)), |b| build(b, d));
        }
    }

    /// The door and one or two windows.
    fn openings(&mut self) {
        if let Some((place, _)) = self.places.hang(&mut self.d, [1.06, 2.11], [1.055, 1.056]) {
            // Keep the way to the door free.
            self.places.take(
                &place.then(&Placement::upright(vec3(0.0, 0.35, 0.0), 0.0)),
                [0.95, 0.7],
                0.0,
            );
            let down = place.then(&Placement::upright(vec3(0.0, 0.0, -0.04), 0.0));
            let d = &mut self.d;
            self.b.object("door", down, |b| walls::door(b, d));
        }
        for _ in 0..self.d.count(1, 2) {
            let (w, h) = (self.d.between(1.1, 1.5), self.d.between(1.05, 1.25));
            let found = self.places.hang(&mut self.d, [w + 0.7, h + 0.4], [1.5, 1.6]);
            let Some((place, _)) = found else { continue };
            let d = &mut self.d;
            self.b.object("window", place, |b| walls::window(b, d, [w, h]));
            let corner = place.point(vec3(w / 2.0, 0.17, -h / 2.0));
            let (eu, ev) = (place.turn(vec3(-w, 0.0, 0.0)), place.turn(vec3(0.0, 0.0, h)));
            self.lights.push(Light::window(corner, eu, ev, DAY * (3.4 * w * h)));
        }
    }

    fn along_the_walls(&mut self) {
        let w = self.d.between(1.45, 2.0);
        self.against_wall("sofa", [w, 0.9, 0.85], |b, d| seating::sofa(b, d, w));
        if self.d.chance(0.85) {
            let (w, h) = (self.d.between(0.75, 1.05), self.d.between(1.5, 1.95));
            self.against_wall("bookcase", [w, 0.3, h], |b, d| storage::bookcase(b, d, w, h));
        }
        if self.d.chance(0.75) {
            let screen = self.d.between(0.75, 0.95);
            let [w, depth, h] = [screen + 0.35, 0.4, self.d.between(0.5, 0.6)];
            let stand = self.against_wall("cabinet", [w, depth, h], |b, d| {
                storage::cabinet(b, d, [w, depth, h]);
            });
            if let Some(place) = stand {
                let on = place.then(&Placement::upright(vec3(0.0, 0.0, h + 0.002), 0.0));
                self.places.block(&on, [screen, 0.6], h + 0.35);
                let d = &mut self.d;
                self.b.object("television", on, |b| storage::television(b, d, screen));
            }
        }
        if self.d.chance(0.45) {
            let w = self.d.pick(&[0.95, 1.4]);
            let bed =
                self.against_wall("bed", [w + 0.08, 2.02, 0.95], |b, d| seating::bed(b, d, w));
            if let Some(place) = bed.filter(|_| self.d.chance(0.6)) {
                let on = place.then(&Placement::upright(vec3(0.1, -0.1, 0.49), 0.2));
                let d = &mut self.d;
                self.b.object("teddy bear", on, |b| decor::teddy(b, d));
            }
        }
        if self.d.chance(0.7) {
            let size = [self.d.between(0.8, 1.2), 0.42, self.d.pick(&[0.85, 0.9, 1.75])];
            let place = self.against_wall("cabinet", size, |b, d| storage::cabinet(b, d, size));
            if let Some(place) = place.filter(|_| size[2] < 1.0) {
                let on = place.then(&Placement::upright(vec3(0.15, 0.0, size[2] + 0.002), 0.0));
                self.table_lamp(&on);
            }
        }
    }

    fn table_lamp(&mut self, on: &Placement) {
        self.places.block(on, [0.3, 0.5], on.origin.z + 0.25);
        let d = &mut self.d;
        self.b.object("lamp", *on, |b| decor::table_lamp(b, d));
        self.lights.push(Light::lamp(on.point(vec3(0.0, 0.0, 0.34)), 0.08, WARM * 0.5));
    }

    fn against_wall(
        &mut self,
        class: &'static str,
        size: [f32; 3],
        build: impl FnOnce(&mut Builder, &mut Dice),
    ) -> Option<Placement> {
        let place = self.places.against_wall(&mut self.d, size)?;
        let d = &mut self.d;
        self.b.object(class, place, |b| build(b, d));
        Some(place)
    }

    /// Plant, floor lamp, bin, stool, box, ball: in corners, along walls, on free floor.
    fn small_things(&mut self) {
        let h = self.d.between(0.85, 1.45);
        let r = 2.0 * decor::plant_radius(h);
        if let Some(place) = self.places.in_corner(&mut self.d, [r, r, h]) {
            let d = &mut self.d;
            self.b.object("potted plant", place, |b| decor::plant(b, d, h));
        }
        let h = self.d.between(1.45, 1.7);
        let lamp =
            self.places.in_corner(&mut self.d, [0.42, 0.42, h]).filter(|_| self.d.chance(0.85));
        if let Some(place) = lamp {
            let d = &mut self.d;
            self.b.object("lamp", place, |b| decor::floor_lamp(b, d, h));
            self.lights.push(Light::lamp(place.point(vec3(0.0, 0.0, h - 0.15)), 0.1, WARM * 1.1));
        }
        self.against_wall("trash can", [0.3, 0.3, 0.36], storage::trash_can);
        if self.d.chance(0.6) {
            self.against_wall("cardboard box", [0.45, 0.36, 0.34], storage::carton);
        }
        let radius = self.d.between(0.11, 0.16);
        self.on_floor("ball", 0.8, 2.0 * radius, |b, d| decor::ball(b, d, radius));
        self.on_floor("stool", 0.6, 0.4, seating::stool);
        self.on_floor("teddy bear", 0.4, 0.4, decor::teddy);
    }

    fn on_floor(
        &mut self,
        class: &'static str,
        likely: f32,
        width: f32,
        build: impl FnOnce(&mut Builder, &mut Dice),
    ) {
        if self.d.chance(likely)
            && let Some(place) = self.places.on_floor(&mut self.d, width)
        {
            let d = &mut self.d;
            self.b.object(class, place, |b| build(b, d));
        }
    }

    /// Pictures and a clock where the wall is free.
    fn hang(&mut self) {
        for _ in 0..self.d.count(2, 4) {
            let size = [self.d.between(0.4, 0.8), self.d.between(0.35, 0.6)];
            let room = [size[0] + 0.15, size[1] + 0.15];
            if let Some((place, _)) = self.places.hang(&mut self.d, room, [1.4, 1.65]) {
                let d = &mut self.d;
                self.b.object("picture", place, |b| walls::picture(b, d, size));
            }
        }
        if self.d.chance(0.85)
            && let Some((place, _)) = self.places.hang(&mut self.d, [0.44, 0.44], [1.6, 1.85])
        {
            let d = &mut self.d;
            self.b.object("clock", place, |b| walls::clock(b, d));
        }
    }
}

fn wall_paint(d: &mut Dice) -> Material {
    let ground =
        rgb(d.pick(&[
            0xe8dfcc, 0xd4dcd8, 0xc8d4de, 0xe4d0bc, 0xd8d2c4, 0xb8c8b4, 0xe6c8b8, 0xa8b8c4,
        ]));
    if d.chance(0.5) {
        return matt(Texture::Plaster(ground));
    }
    let motif = ground.lerp(d.fabric_color(), 0.4);
    matt(Texture::Wallpaper { ground, motif, kind: d.count(0, 2) as u32 })
}
