//! Rigid placements and colors on top of `glam`, in `f32` for the ray tracer.
//!
//! Vectors are positions in metres, unit-free directions or linear RGB. Camera poses are
//! `nalgebra`'s, in `f64`.

use glam::{Vec3, vec3};

/// Linear RGB of an sRGB hex triple such as `0x8b5a2b`.
pub(crate) fn rgb(hex: u32) -> Vec3 {
    let channel = |shift: u32| {
        let s = ((hex >> shift) & 255) as f32 / 255.0;
        if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
    };
    vec3(channel(16), channel(8), channel(0))
}

/// Rec. 709 luminance of a linear color.
#[inline(always)]
pub(crate) fn luminance(color: Vec3) -> f32 {
    0.2126 * color.x + 0.7152 * color.y + 0.0722 * color.z
}

/// A unit vector at right angles to a unit vector. Rooms depend on which one, so it is not glam's.
pub(crate) fn perpendicular(direction: Vec3) -> Vec3 {
    let other = if direction.x.abs() < 0.8 { Vec3::X } else { Vec3::Y };
    direction.cross(other).normalize_or(Vec3::Z)
}

/// A rigid placement: columns of the rotation and the translation, `outer_from_inner`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placement {
    pub right: Vec3,
    pub front: Vec3,
    pub up: Vec3,
    pub origin: Vec3,
}

impl Placement {
    pub const IDENTITY: Placement =
        Placement { right: Vec3::X, front: Vec3::Y, up: Vec3::Z, origin: Vec3::ZERO };

    /// At `origin`, turned by `yaw` radians about the vertical.
    pub fn upright(origin: Vec3, yaw: f32) -> Self {
        let (s, c) = yaw.sin_cos();
        Self { right: vec3(c, s, 0.0), front: vec3(-s, c, 0.0), origin, ..Self::IDENTITY }
    }

    /// At `origin`, tilted by `angle` radians about the inner x axis (front rises for positive).
    pub fn tilted(origin: Vec3, angle: f32) -> Self {
        let (s, c) = angle.sin_cos();
        Self { front: vec3(0.0, c, s), up: vec3(0.0, -s, c), origin, ..Self::IDENTITY }
    }

    /// A direction of the inner frame in the outer one.
    #[inline(always)]
    pub fn turn(&self, d: Vec3) -> Vec3 {
        self.right * d.x + self.front * d.y + self.up * d.z
    }

    /// A point of the inner frame in the outer one.
    #[inline(always)]
    pub fn point(&self, p: Vec3) -> Vec3 {
        self.turn(p) + self.origin
    }

    /// A point of the outer frame in the inner one.
    #[inline(always)]
    pub fn inverse_point(&self, p: Vec3) -> Vec3 {
        let d = p - self.origin;
        vec3(d.dot(self.right), d.dot(self.front), d.dot(self.up))
    }

    /// `self ∘ inner`.
    pub fn then(&self, inner: &Placement) -> Placement {
        Placement {
            right: self.turn(inner.right),
            front: self.turn(inner.front),
            up: self.turn(inner.up),
            origin: self.point(inner.origin),
        }
    }
}
