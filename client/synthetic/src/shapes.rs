//! The builder that furniture is made with: boxes with rounded edges, lathed profiles, tubes,
//! ellipsoids, panels and free sheets, all in the frame of the object under construction (metres,
//! z up, front towards +y). It adds patches to a [`Mesh`] and lists the instances.

use crate::material::Material;
use crate::mesh::{Grid, Mesh, Oriented, Patch, light_grid};
use crate::vector::{Placement, perpendicular};
use glam::{Vec3, vec3};
use std::f32::consts::TAU;

/// Collects patches and instances.
pub(crate) struct Builder {
    pub mesh: Mesh,
    /// Class name of instance `i + 1`.
    pub classes: Vec<&'static str>,
    placement: Placement,
    instance: u8,
}

/// Profile corners sharper than this (cosine) stay sharp.
const CREASE: f32 = 0.8;

impl Builder {
    pub fn new() -> Self {
        Self {
            mesh: Mesh::default(),
            classes: Vec::new(),
            placement: Placement::IDENTITY,
            instance: 0,
        }
    }

    /// Builds one instance of `class` at `placement` (relative to the enclosing one).
    pub fn object(
        &mut self,
        class: &'static str,
        placement: Placement,
        build: impl FnOnce(&mut Self),
    ) {
        assert!(self.classes.len() < 255, "instance ids are one byte");
        self.classes.push(class);
        let outer = self.instance;
        self.instance = self.classes.len() as u8;
        self.within(placement, build);
        self.instance = outer;
    }

    /// Builds parts in a frame of their own inside the current one.
    pub fn within(&mut self, placement: Placement, build: impl FnOnce(&mut Self)) {
        let outer = self.placement;
        self.placement = outer.then(&placement);
        build(self);
        self.placement = outer;
    }

    /// Adds the surface `shape(u, v) -> (position, normal)` to the instance under construction.
    fn patch(&mut self, grid: &Grid, material: Material, shape: impl Fn(f32, f32) -> (Vec3, Vec3)) {
        let patch = Patch {
            instance: self.instance,
            material,
            metres: grid.metres,
            placement: self.placement,
            light: grid.light,
            texels: Vec::new(),
        };
        self.mesh.add(grid, patch, |u, v| {
            let (position, normal) = shape(u, v);
            Oriented { position, normal }
        });
    }

    /// A flat parallelogram from `origin` along `eu` (u) and `ev` (v); its normal is `eu × ev`.
    pub fn panel(&mut self, origin: Vec3, eu: Vec3, ev: Vec3, material: Material) {
        let grid = Grid::even(1, 1, [eu.length(), ev.length()]);
        let normal = eu.cross(ev).normalize_or(Vec3::Z);
        self.patch(&grid, material, |a, b| (origin + eu * a + ev * b, normal));
    }

    /// Like [`Self::panel`], with light texels `texel` metres apart (for walls and floors).
    pub fn plane(&mut self, [origin, eu, ev]: [Vec3; 3], texel: f32, material: Material) {
        let metres = [eu.length(), ev.length()];
        let grid = Grid { light: light_grid(metres, texel), ..Grid::even(1, 1, metres) };
        let normal = eu.cross(ev).normalize_or(Vec3::Z);
        self.patch(&grid, material, |a, b| (origin + eu * a + ev * b, normal));
    }

    /// A box of full size `size` around `centre`, edges rounded with `radius`.
    pub fn slab(&mut self, centre: Vec3, size: Vec3, radius: f32, material: Material) {
        let half = size * 0.5;
        let radius = radius.min(half.x.min(half.y).min(half.z));
        for axis in 0..3 {
            for sign in [-1.0_f32, 1.0] {
                let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
                // For the negative side u and v swap, so that the normal still points outwards.
                let (a, b) = if sign > 0.0 { (a, b) } else { (b, a) };
                let (ha, hb) = (half[a], half[b]);
                let grid = Grid {
                    us: bevelled(ha, radius),
                    vs: bevelled(hb, radius),
                    ..Grid::even(1, 1, [2.0 * ha, 2.0 * hb])
                };
                let inner = [half.x - radius, half.y - radius, half.z - radius];
                self.patch(&grid, material, |s, t| {
                    let mut p = [0.0; 3];
                    p[axis] = sign * half[axis];
                    p[a] = (2.0 * s - 1.0) * ha;
                    p[b] = (2.0 * t - 1.0) * hb;
                    let mut flat = [0.0; 3];
                    flat[axis] = sign;
                    rounded(p, inner, radius, flat).map_position(centre)
                });
            }
        }
    }

    /// A surface of revolution about the vertical through `base`: `profile` lists (radius, height).
    /// Outer surfaces go upwards. Sharp corners of the profile stay sharp.
    pub fn lathe(&mut self, base: Vec3, profile: &[(f32, f32)], material: Material) {
        let mut start = 0;
        for end in 1..profile.len() {
            let last = end == profile.len() - 1;
            if last || bend(profile, end) < CREASE {
                self.lathe_run(base, &profile[start..=end], material);
                start = end;
            }
        }
    }

    fn lathe_run(&mut self, base: Vec3, run: &[(f32, f32)], material: Material) {
        let lengths: Vec<f32> =
            run.windows(2).map(|w| (w[1].0 - w[0].0).hypot(w[1].1 - w[0].1)).collect();
        let total: f32 = lengths.iter().sum();
        let mut vs = vec![0.0];
        for length in &lengths {
            vs.push(vs[vs.len() - 1] + length / total);
        }
        let widest = run.iter().map(|p| p.0).fold(0.0, f32::max);
        let sides = (widest * 90.0).clamp(12.0, 36.0) as usize;
        let metres = [widest * TAU, total];
        let mut light = light_grid(metres, 0.06);
        light = [light[0].clamp(9, 25), light[1].max(run.len().min(8))];
        let grid = Grid { vs: vs.clone(), light, ..Grid::even(sides, 1, metres) };
        let normals: Vec<(f32, f32)> = (0..run.len()).map(|i| profile_normal(run, i)).collect();
        self.patch(&grid, material, |u, t| {
            let i = vs.iter().rposition(|&s| s <= t).unwrap_or(0).min(run.len() - 2);
            let f = ((t - vs[i]) / (vs[i + 1] - vs[i]).max(1e-9)).clamp(0.0, 1.0);
            let blend =
                |a: (f32, f32), b: (f32, f32)| (a.0 + (b.0 - a.0) * f, a.1 + (b.1 - a.1) * f);
            let (r, z) = blend(run[i], run[i + 1]);
            let (nr, nz) = blend(normals[i], normals[i + 1]);
            let (s, c) = (u * TAU).sin_cos();
            (base + vec3(r * c, r * s, z), vec3(nr * c, nr * s, nz))
        });
    }

    /// An upright closed cylinder standing on `base`.
    pub fn cylinder(&mut self, base: Vec3, radius: f32, height: f32, material: Material) {
        let profile = [(0.0, 0.0), (radius, 0.0), (radius, height), (0.0, height)];
        self.lathe(base, &profile, material);
    }

    /// A round tube along `points`.
    pub fn tube(&mut self, points: &[Vec3], radius: f32, material: Material) {
        let n = points.len() - 1;
        let length: f32 = points.windows(2).map(|w| (w[1] - w[0]).length()).sum();
        let sides = if radius > 0.02 { 12 } else { 8 };
        let metres = [radius * TAU, length];
        let grid = Grid { light: [5, light_grid(metres, 0.08)[1]], ..Grid::even(sides, n, metres) };
        let at = |t: f32| {
            let i = ((t * n as f32) as usize).min(n - 1);
            let f = t * n as f32 - i as f32;
            let tangent =
                |k: usize| (points[(k + 1).min(n)] - points[k.max(1) - 1]).normalize_or(Vec3::Z);
            (
                points[i].lerp(points[i + 1], f),
                tangent(i).lerp(tangent(i + 1), f).normalize_or(Vec3::Z),
            )
        };
        let side = perpendicular(at(0.0).1);
        self.patch(&grid, material, |u, t| {
            let (centre, along) = at(t);
            let x = (side - along * side.dot(along)).normalize_or(Vec3::Z);
            let y = along.cross(x);
            let (s, c) = (u * TAU).sin_cos();
            let out = x * c + y * s;
            (centre + out * radius, out)
        });
    }

    /// An ellipsoid with half axes `radii`.
    pub fn ball(&mut self, centre: Vec3, radii: Vec3, material: Material) {
        let widest = radii.x.max(radii.y).max(radii.z);
        let n = (widest * 80.0).clamp(8.0, 20.0) as usize;
        let metres = [widest * TAU, widest * TAU / 2.0];
        let light = light_grid(metres, 0.05).map(|k| k.clamp(7, 17));
        let grid = Grid { light, ..Grid::even(2 * n, n, metres) };
        self.patch(&grid, material, |u, t| {
            let (s, c) = (u * TAU).sin_cos();
            let (st, ct) = ((t - 0.5) * TAU / 2.0).sin_cos();
            let d = vec3(c * ct, s * ct, st);
            (centre + d * radii, vec3(d.x / radii.x, d.y / radii.y, d.z / radii.z))
        });
    }

    /// A disc of the given radius in the plane y = 0, facing +y; (u, v) run over its square.
    pub fn disc(&mut self, radius: f32, material: Material) {
        const SIDES: usize = 36;
        let lines = |n: usize| (0..=n).map(|i| i as f32 / n as f32).collect::<Vec<_>>();
        let grid =
            Grid { us: lines(SIDES), vs: lines(1), light: [2, 2], metres: [2.0 * radius; 2] };
        self.patch(&grid, material, |u, t| {
            let (s, c) = (u * TAU).sin_cos();
            (vec3(-c * t * radius, 0.0, s * t * radius), vec3(0.0, 1.0, 0.0))
        });
        // The grid is polar, prints are not: move every corner to its place in the square.
        let patch = self.mesh.patches.len() as u32 - 1;
        for facet in self.mesh.facets.iter_mut().rev().take_while(|f| f.patch == patch) {
            for uv in &mut facet.uv {
                let (s, c) = (uv[0] * TAU).sin_cos();
                *uv = [0.5 + 0.5 * c * uv[1], 0.5 + 0.5 * s * uv[1]];
            }
        }
    }

    /// A free surface; normals come from differences (`∂u × ∂v`).
    pub fn sheet(&mut self, grid: &Grid, material: Material, shape: impl Fn(f32, f32) -> Vec3) {
        self.patch(grid, material, |u, t| {
            const H: f32 = 0.01;
            let du = shape(u + H, t) - shape(u - H, t);
            let dv = shape(u, t + H) - shape(u, t - H);
            (shape(u, t), du.cross(dv).normalize_or(Vec3::Z))
        });
    }
}

/// A surface point before it is moved to the box's centre.
struct Rounded(Vec3, Vec3);

impl Rounded {
    fn map_position(self, centre: Vec3) -> (Vec3, Vec3) {
        (self.0 + centre, self.1)
    }
}

/// Moves a point of a cube's face onto the box with rounded edges.
fn rounded(p: [f32; 3], inner: [f32; 3], radius: f32, flat: [f32; 3]) -> Rounded {
    let q: [f32; 3] = std::array::from_fn(|i| p[i].clamp(-inner[i], inner[i]));
    let as_v = |a: [f32; 3]| vec3(a[0], a[1], a[2]);
    if radius <= 0.0 {
        return Rounded(as_v(p), as_v(flat));
    }
    let normal = (as_v(p) - as_v(q)).normalize_or(Vec3::Z);
    Rounded(as_v(q) + normal * radius, normal)
}

/// Grid lines of a face of half width `half`: more of them where the edge is round.
fn bevelled(half: f32, radius: f32) -> Vec<f32> {
    if radius <= 0.0 {
        return vec![0.0, 1.0];
    }
    let r = radius / (2.0 * half);
    // A wide radius (upholstery) needs more lines than the softened edge of a board.
    let steps = if radius > 0.03 { 4 } else { 1 };
    let mut lines: Vec<f32> = (0..=steps).map(|i| r * i as f32 / steps as f32).collect();
    let mirrored: Vec<f32> = lines.iter().rev().map(|l| 1.0 - l).collect();
    lines.extend(mirrored.into_iter().filter(|l| *l > r + 1e-4));
    lines
}

/// Cosine of the bend of a profile at an inner point.
fn bend(profile: &[(f32, f32)], i: usize) -> f32 {
    let d = |a: (f32, f32), b: (f32, f32)| {
        let (x, y) = (b.0 - a.0, b.1 - a.1);
        let l = x.hypot(y).max(1e-9);
        (x / l, y / l)
    };
    let (before, after) = (d(profile[i - 1], profile[i]), d(profile[i], profile[i + 1]));
    before.0 * after.0 + before.1 * after.1
}

/// Normal (radial, vertical) at a profile point: the mean of its segments' normals.
fn profile_normal(run: &[(f32, f32)], i: usize) -> (f32, f32) {
    let mut sum = (0.0, 0.0);
    for k in [i.wrapping_sub(1), i] {
        if k < run.len() - 1 {
            let (x, y) = (run[k + 1].0 - run[k].0, run[k + 1].1 - run[k].1);
            let l = x.hypot(y).max(1e-9);
            sum = (sum.0 + y / l, sum.1 - x / l);
        }
    }
    sum
}
