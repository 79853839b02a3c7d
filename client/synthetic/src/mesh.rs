//! The scene as patches. A patch is a surface f(u, v) over the unit square: a grid of triangles for
//! rays and a grid of texels for baked light. Shapes are given in an object's own frame (metres);
//! the [`Mesh`] is in the world.

use crate::material::Material;
use crate::vector::Placement;
use glam::Vec3;

/// Geometry of a triangle, for rays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Triangle {
    pub corner: Vec3,
    pub edge1: Vec3,
    pub edge2: Vec3,
}

/// Shading data of a triangle: its patch, and (u, v) and unit normals at the corners.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Facet {
    pub patch: u32,
    pub uv: [[f32; 2]; 3],
    pub normals: [Vec3; 3],
}

impl Facet {
    /// (u, v) at barycentric weights of the second and third corner.
    #[inline(always)]
    pub fn uv_at(&self, b1: f32, b2: f32) -> [f32; 2] {
        let b0 = 1.0 - b1 - b2;
        let [a, b, c] = self.uv;
        [a[0] * b0 + b[0] * b1 + c[0] * b2, a[1] * b0 + b[1] * b1 + c[1] * b2]
    }

    /// Interpolated normal, unit length.
    #[inline(always)]
    pub fn normal_at(&self, b1: f32, b2: f32) -> Vec3 {
        (self.normals[0] * (1.0 - b1 - b2) + self.normals[1] * b1 + self.normals[2] * b2)
            .normalize_or(Vec3::Z)
    }
}

/// A point of a surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Oriented {
    /// Position, metres.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
}

/// A corner of a triangle.
#[derive(Clone, Copy, Debug)]
struct Corner {
    at: Oriented,
    uv: [f32; 2],
}

/// One surface: its instance, material and light grid.
#[derive(Clone, Debug)]
pub(crate) struct Patch {
    /// Instance id, 1-based.
    pub instance: u8,
    pub material: Material,
    /// Size of the unit square in metres, for textures with a physical scale.
    pub metres: [f32; 2],
    /// `world_from_object`, for solid textures.
    pub placement: Placement,
    /// Columns and rows of the light grid; texels lie on the corners of its cells.
    pub light: [usize; 2],
    /// Every texel in the world, row by row.
    pub texels: Vec<Oriented>,
}

/// All triangles of the scene; `triangles[i]` and `facets[i]` belong together.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mesh {
    pub triangles: Vec<Triangle>,
    pub facets: Vec<Facet>,
    pub patches: Vec<Patch>,
}

/// Sampling of a patch: grid lines for triangles, the light grid, and its size.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    pub us: Vec<f32>,
    pub vs: Vec<f32>,
    pub light: [usize; 2],
    pub metres: [f32; 2],
}

/// Spacing of light texels on ordinary surfaces, metres.
const TEXEL: f32 = 0.06;

impl Grid {
    /// Evenly spaced grid lines, light texels about [`TEXEL`] apart.
    pub fn even(nu: usize, nv: usize, metres: [f32; 2]) -> Self {
        let lines = |n: usize| (0..=n).map(|i| i as f32 / n as f32).collect();
        Self { us: lines(nu), vs: lines(nv), light: light_grid(metres, TEXEL), metres }
    }
}

/// Columns and rows of a light grid with texels at most `texel` metres apart.
pub(crate) fn light_grid(metres: [f32; 2], texel: f32) -> [usize; 2] {
    metres.map(|m| (m / texel).ceil().clamp(1.0, 160.0) as usize + 1)
}

impl Mesh {
    /// Adds the surface `shape(u, v)`, given in the object's frame.
    pub fn add(&mut self, grid: &Grid, mut patch: Patch, shape: impl Fn(f32, f32) -> Oriented) {
        let placement = patch.placement;
        let place = |u: f32, v: f32| {
            let Oriented { position, normal } = shape(u, v);
            Oriented {
                position: placement.point(position),
                normal: placement.turn(normal).normalize_or(Vec3::Z),
            }
        };
        let index = self.patches.len() as u32;
        let columns = grid.us.len();
        let corners: Vec<_> = grid
            .vs
            .iter()
            .flat_map(|&v| grid.us.iter().map(move |&u| (u, v)))
            .map(|(u, v)| Corner { at: place(u, v), uv: [u, v] })
            .collect();
        for row in 0..grid.vs.len() - 1 {
            for column in 0..columns - 1 {
                let a = row * columns + column;
                let (b, c, d) = (a + 1, a + columns + 1, a + columns);
                for [i, j, k] in [[a, b, c], [a, c, d]] {
                    self.triangle(index, [corners[i], corners[j], corners[k]]);
                }
            }
        }
        let [columns, rows] = grid.light;
        let even = |i: usize, n: usize| i as f32 / (n - 1) as f32;
        patch.texels = (0..rows)
            .flat_map(|r| (0..columns).map(move |c| (even(c, columns), even(r, rows))))
            .map(|(u, v)| place(u, v))
            .collect();
        self.patches.push(patch);
    }

    fn triangle(&mut self, patch: u32, corners: [Corner; 3]) {
        let [a, b, c] = corners.map(|corner| corner.at.position);
        let (edge1, edge2) = (b - a, c - a);
        if edge1.cross(edge2).length() < 1e-12 {
            return;
        }
        self.triangles.push(Triangle { corner: a, edge1, edge2 });
        self.facets.push(Facet {
            patch,
            uv: corners.map(|corner| corner.uv),
            normals: corners.map(|corner| corner.at.normal),
        });
    }

    /// Smallest and largest corner of the triangles of one instance.
    pub fn bounds(&self, instance: u8) -> (Vec3, Vec3) {
        let mut low = Vec3 { x: f32::MAX, y: f32::MAX, z: f32::MAX };
        let mut high = -low;
        for (triangle, facet) in self.triangles.iter().zip(&self.facets) {
            if self.patches[facet.patch as usize].instance == instance {
                let a = triangle.corner;
                for p in [a, a + triangle.edge1, a + triangle.edge2] {
                    low = low.min(p);
                    high = high.max(p);
                }
            }
        }
        (low, high)
    }
}
