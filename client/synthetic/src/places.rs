//! Free space of a room: occupied rectangles of the floor and covered rectangles of the walls.
//! Finds placements without collisions.

use crate::dice::Dice;
use crate::vector::Placement;
use glam::{Vec3, vec3};
use std::f32::consts::{FRAC_PI_2, PI};

/// A wall by the way it faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Wall(usize);

impl Wall {
    pub const ALL: [Wall; 4] = [Wall(0), Wall(1), Wall(2), Wall(3)];
}

/// An axis-aligned rectangle.
#[derive(Clone, Copy, Debug)]
struct Rectangle {
    low: [f32; 2],
    high: [f32; 2],
}

impl Rectangle {
    fn overlaps(&self, other: &Rectangle, gap: f32) -> bool {
        (0..2).all(|i| self.low[i] < other.high[i] + gap && other.low[i] < self.high[i] + gap)
    }
}

/// Free floor and walls of a room of the given size (x, y, height).
#[derive(Clone, Debug)]
pub(crate) struct Places {
    pub size: Vec3,
    floor: Vec<Rectangle>,
    /// Per wall: rectangles (along the wall, height).
    walls: [Vec<Rectangle>; 4],
}

const TRIES: usize = 300;
const GAP: f32 = 0.04;

impl Places {
    pub fn new(size: Vec3) -> Self {
        Self { size, floor: Vec::new(), walls: Default::default() }
    }

    /// Length of a wall, metres.
    pub fn length(&self, wall: Wall) -> f32 {
        if wall.0.is_multiple_of(2) { self.size.x } else { self.size.y }
    }

    /// The frame at `along` metres from a wall's middle (to the right of its front), height `z`.
    pub fn on_wall(&self, wall: Wall, along: f32, z: f32) -> Placement {
        let yaw = [0.0, FRAC_PI_2, PI, -FRAC_PI_2][wall.0];
        let turned = Placement::upright(Vec3::ZERO, yaw);
        let distance = if wall.0.is_multiple_of(2) { self.size.y } else { self.size.x } / 2.0;
        let origin = turned.right * along - turned.front * distance + vec3(0.0, 0.0, z);
        Placement { origin, ..turned }
    }

    /// Marks the footprint `size` around a placement as taken, widened by `margin`.
    pub fn take(&mut self, place: &Placement, size: [f32; 2], margin: f32) {
        self.floor.push(footprint(place, size, margin));
    }

    /// Covers the wall behind an object: width and height around `z`.
    pub fn block(&mut self, place: &Placement, [w, h]: [f32; 2], z: f32) {
        for wall in Wall::ALL {
            let frame = self.on_wall(wall, 0.0, 0.0);
            if frame.front.dot(place.front) > 0.9 {
                let s = frame.inverse_point(place.origin).x;
                self.walls[wall.0].push(Rectangle {
                    low: [s - w / 2.0, z - h / 2.0],
                    high: [s + w / 2.0, z + h / 2.0],
                });
            }
        }
    }

    /// A place with its back to a wall for an object of [width, depth, height].
    pub fn against_wall(&mut self, d: &mut Dice, [w, depth, h]: [f32; 3]) -> Option<Placement> {
        for _ in 0..TRIES {
            let wall = d.pick(&Wall::ALL);
            let reach = self.length(wall) / 2.0 - w / 2.0 - 0.03;
            let along = d.between(-reach, reach);
            if let Some(place) = self.try_wall(wall, along, [w, depth, h]) {
                return Some(place);
            }
        }
        None
    }

    /// A place in a corner, or else anywhere along a wall.
    pub fn in_corner(&mut self, d: &mut Dice, [w, depth, h]: [f32; 3]) -> Option<Placement> {
        for _ in 0..12 {
            let wall = d.pick(&Wall::ALL);
            let reach = self.length(wall) / 2.0 - w / 2.0 - 0.05;
            let along = if d.chance(0.5) { reach } else { -reach };
            if let Some(place) = self.try_wall(wall, along, [w, depth, h]) {
                return Some(place);
            }
        }
        self.against_wall(d, [w, depth, h])
    }

    fn try_wall(&mut self, wall: Wall, along: f32, [w, depth, h]: [f32; 3]) -> Option<Placement> {
        let wall_frame = self.on_wall(wall, along, 0.0);
        let place = wall_frame.then(&Placement::upright(vec3(0.0, depth / 2.0 + 0.03, 0.0), 0.0));
        let ground = footprint(&place, [w, depth], 0.0);
        let cover = Rectangle { low: [along - w / 2.0, 0.0], high: [along + w / 2.0, h] };
        if self.floor.iter().any(|r| r.overlaps(&ground, GAP))
            || self.walls[wall.0].iter().any(|r| r.overlaps(&cover, GAP))
        {
            return None;
        }
        self.floor.push(ground);
        self.walls[wall.0].push(cover);
        Some(place)
    }

    /// A free place on a wall for [width, height], its middle between the given heights.
    pub fn hang(
        &mut self,
        d: &mut Dice,
        [w, h]: [f32; 2],
        [low, high]: [f32; 2],
    ) -> Option<(Placement, Wall)> {
        for _ in 0..TRIES {
            let wall = d.pick(&Wall::ALL);
            let reach = self.length(wall) / 2.0 - w / 2.0 - 0.08;
            let (along, z) = (d.between(-reach, reach), d.between(low, high));
            let cover = Rectangle {
                low: [along - w / 2.0, z - h / 2.0],
                high: [along + w / 2.0, (z + h / 2.0).min(self.size.z)],
            };
            if !self.walls[wall.0].iter().any(|r| r.overlaps(&cover, GAP)) {
                self.walls[wall.0].push(cover);
                return Some((self.on_wall(wall, along, z), wall));
            }
        }
        None
    }

    /// A free place anywhere on the floor, with a random turn.
    pub fn on_floor(&mut self, d: &mut Dice, width: f32) -> Option<Placement> {
        for _ in 0..TRIES {
            let (hx, hy) = (self.size.x / 2.0 - width, self.size.y / 2.0 - width);
            let place = Placement::upright(
                vec3(d.between(-hx, hx), d.between(-hy, hy), 0.0),
                d.between(0.0, 2.0 * PI),
            );
            let ground = footprint(
                &Placement { origin: place.origin, ..Placement::IDENTITY },
                [width; 2],
                0.0,
            );
            if !self.floor.iter().any(|r| r.overlaps(&ground, GAP)) {
                self.floor.push(ground);
                return Some(place);
            }
        }
        None
    }
}

/// Bounding rectangle of a turned footprint.
fn footprint(place: &Placement, [w, depth]: [f32; 2], margin: f32) -> Rectangle {
    let extent = |axis: usize| {
        place.right[axis].abs() * w / 2.0 + place.front[axis].abs() * depth / 2.0 + margin
    };
    let (ex, ey) = (extent(0), extent(1));
    Rectangle {
        low: [place.origin.x - ex, place.origin.y - ey],
        high: [place.origin.x + ex, place.origin.y + ey],
    }
}
