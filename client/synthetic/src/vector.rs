//! Three-vectors and placements in `f32` for the ray caster: small, copied, inlined by hand because
//! the development profile inlines little. In and out: metres (positions) or unit-free
//! (directions, linear RGB). Not for poses: those are `nalgebra` in `f64`.

use std::ops::{Add, Mul, Neg, Sub};

/// A point, a direction or a linear RGB color.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct V3 {
    pub x: f32,
    pub y: f32,
    pub z: f32,
}

/// Shorthand constructor.
#[inline(always)]
pub(crate) const fn v(x: f32, y: f32, z: f32) -> V3 {
    V3 { x, y, z }
}

/// Linear RGB from an sRGB hex triple such as `0x8b5a2b`.
pub(crate) fn rgb(hex: u32) -> V3 {
    let channel = |shift: u32| {
        let s = ((hex >> shift) & 255) as f32 / 255.0;
        if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
    };
    v(channel(16), channel(8), channel(0))
}

impl V3 {
    pub const ZERO: V3 = v(0.0, 0.0, 0.0);

    #[inline(always)]
    pub fn dot(self, o: V3) -> f32 {
        self.x * o.x + self.y * o.y + self.z * o.z
    }

    #[inline(always)]
    pub fn cross(self, o: V3) -> V3 {
        v(self.y * o.z - self.z * o.y, self.z * o.x - self.x * o.z, self.x * o.y - self.y * o.x)
    }

    #[inline(always)]
    pub fn length(self) -> f32 {
        self.dot(self).sqrt()
    }

    /// The direction; straight up for a zero vector.
    #[inline(always)]
    pub fn unit(self) -> V3 {
        let length = self.length();
        if length > 1e-12 { self * (1.0 / length) } else { v(0.0, 0.0, 1.0) }
    }

    /// Component-wise product (color filters).
    #[inline(always)]
    pub fn times(self, o: V3) -> V3 {
        v(self.x * o.x, self.y * o.y, self.z * o.z)
    }

    #[inline(always)]
    pub fn mix(self, o: V3, t: f32) -> V3 {
        self * (1.0 - t) + o * t
    }

    pub fn min(self, o: V3) -> V3 {
        v(self.x.min(o.x), self.y.min(o.y), self.z.min(o.z))
    }

    pub fn max(self, o: V3) -> V3 {
        v(self.x.max(o.x), self.y.max(o.y), self.z.max(o.z))
    }

    /// Rec. 709 luminance of a linear color.
    #[inline(always)]
    pub fn luminance(self) -> f32 {
        0.2126 * self.x + 0.7152 * self.y + 0.0722 * self.z
    }

    #[inline(always)]
    pub fn axis(self, axis: usize) -> f32 {
        match axis {
            0 => self.x,
            1 => self.y,
            _ => self.z,
        }
    }

    /// Any unit vector at right angles to this unit vector.
    pub fn perpendicular(self) -> V3 {
        let other = if self.x.abs() < 0.8 { v(1.0, 0.0, 0.0) } else { v(0.0, 1.0, 0.0) };
        self.cross(other).unit()
    }
}

impl Add for V3 {
    type Output = V3;
    #[inline(always)]
    fn add(self, o: V3) -> V3 {
        v(self.x + o.x, self.y + o.y, self.z + o.z)
    }
}

impl Sub for V3 {
    type Output = V3;
    #[inline(always)]
    fn sub(self, o: V3) -> V3 {
        v(self.x - o.x, self.y - o.y, self.z - o.z)
    }
}

impl Mul<f32> for V3 {
    type Output = V3;
    #[inline(always)]
    fn mul(self, s: f32) -> V3 {
        v(self.x * s, self.y * s, self.z * s)
    }
}

impl Neg for V3 {
    type Output = V3;
    #[inline(always)]
    fn neg(self) -> V3 {
        v(-self.x, -self.y, -self.z)
    }
}

/// A rigid placement: columns of the rotation and the translation, `outer_from_inner`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placement {
    pub right: V3,
    pub front: V3,
    pub up: V3,
    pub origin: V3,
}

impl Placement {
    pub const IDENTITY: Placement = Placement {
        right: v(1.0, 0.0, 0.0),
        front: v(0.0, 1.0, 0.0),
        up: v(0.0, 0.0, 1.0),
        origin: V3::ZERO,
    };

    /// At `origin`, turned by `yaw` radians about the vertical.
    pub fn upright(origin: V3, yaw: f32) -> Self {
        let (s, c) = yaw.sin_cos();
        Self { right: v(c, s, 0.0), front: v(-s, c, 0.0), origin, ..Self::IDENTITY }
    }

    /// At `origin`, tilted by `angle` radians about the inner x axis (front rises for positive).
    pub fn tilted(origin: V3, angle: f32) -> Self {
        let (s, c) = angle.sin_cos();
        Self { front: v(0.0, c, s), up: v(0.0, -s, c), origin, ..Self::IDENTITY }
    }

    #[inline(always)]
    pub fn turn(&self, d: V3) -> V3 {
        self.right * d.x + self.front * d.y + self.up * d.z
    }

    #[inline(always)]
    pub fn point(&self, p: V3) -> V3 {
        self.turn(p) + self.origin
    }

    #[inline(always)]
    pub fn inverse_point(&self, p: V3) -> V3 {
        let d = p - self.origin;
        v(d.dot(self.right), d.dot(self.front), d.dot(self.up))
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
