//! Diffuse light, baked once per room: for every texel of every patch the irradiance (linear RGB)
//! from lamps and windows with soft shadows, and one bounce off the other surfaces, which darkens
//! corners and bleeds color. Highlights depend on the view and are in [`crate::render`].

use crate::bvh::{Bvh, Ray};
use crate::mesh::{Mesh, Oriented};
use crate::vector::perpendicular;
use glam::{Vec3, vec3};
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_PI, PI};

/// An area light, as points that share its power.
#[derive(Clone, Debug)]
pub(crate) struct Light {
    pub points: Vec<Vec3>,
    /// Facing, for windows; lamps shine all around.
    pub facing: Option<Vec3>,
    /// Irradiance at one metre, linear RGB.
    pub power: Vec3,
}

impl Light {
    /// A glowing ball.
    pub fn lamp(centre: Vec3, radius: f32, power: Vec3) -> Self {
        const POINTS: usize = 6;
        let points = (0..POINTS)
            .map(|i| {
                let z = 1.0 - (2.0 * i as f32 + 1.0) / POINTS as f32;
                let (s, c) = (i as f32 * 2.4).sin_cos();
                let r = (1.0 - z * z).sqrt();
                centre + vec3(r * c, r * s, z) * radius
            })
            .collect();
        Self { points, facing: None, power }
    }

    /// A window: a grid of points over the parallelogram.
    pub fn window(origin: Vec3, eu: Vec3, ev: Vec3, power: Vec3) -> Self {
        let at = |i: usize, n: usize| (i as f32 + 0.5) / n as f32;
        let points = (0..12).map(|i| origin + eu * at(i % 4, 4) + ev * at(i / 4, 3)).collect();
        Self { points, facing: Some(eu.cross(ev).normalize_or(Vec3::Z)), power }
    }

    /// Centre of its points.
    pub fn centre(&self) -> Vec3 {
        self.points.iter().fold(Vec3::ZERO, |a, &p| a + p) * (1.0 / self.points.len() as f32)
    }
}

/// Irradiance at every light texel, patch by patch, in the texels' order.
#[derive(Clone, Debug)]
pub(crate) struct Baked {
    patches: Vec<Vec<Vec3>>,
}

/// Rays that gather the bounced light of one texel.
const GATHER: usize = 28;
/// Light after more than one bounce, as a share of the albedo.
const FURTHER_BOUNCES: f32 = 0.22;
const OFFSET: f32 = 2e-3;

impl Baked {
    /// Bakes all patches; deterministic.
    pub fn bake(mesh: &Mesh, bvh: &Bvh, lights: &[Light]) -> Self {
        let direct: Vec<Vec<Vec3>> = mesh
            .patches
            .par_iter()
            .map(|patch| {
                patch.texels.iter().map(|&texel| direct_light(mesh, bvh, lights, texel)).collect()
            })
            .collect();
        let direct = Self { patches: direct };
        let albedos: Vec<Vec3> = mesh.patches.iter().map(|p| p.material.mean_albedo()).collect();
        let patches = mesh
            .patches
            .par_iter()
            .zip(&direct.patches)
            .map(|(patch, own)| {
                let bounced: Vec<Vec3> = patch
                    .texels
                    .iter()
                    .map(|&texel| gather(mesh, bvh, &direct, &albedos, texel))
                    .collect();
                let bounced = smooth(&bounced, patch.light);
                own.iter().zip(&bounced).map(|(&a, &b)| a + b).collect()
            })
            .collect();
        Self { patches }
    }

    /// Irradiance at (u, v) of a patch, bilinear between texels.
    #[inline]
    pub fn at(&self, mesh: &Mesh, patch: u32, uv: [f32; 2]) -> Vec3 {
        let [columns, rows] = mesh.patches[patch as usize].light;
        let texels = &self.patches[patch as usize];
        let place = |t: f32, n: usize| {
            let x = t.clamp(0.0, 1.0) * (n - 1) as f32;
            let i = (x as usize).min(n - 2);
            (i, x - i as f32)
        };
        let ((i, fx), (j, fy)) = (place(uv[0], columns), place(uv[1], rows));
        let low = texels[j * columns + i].lerp(texels[j * columns + i + 1], fx);
        let high = texels[(j + 1) * columns + i].lerp(texels[(j + 1) * columns + i + 1], fx);
        low.lerp(high, fy)
    }
}

fn direct_light(mesh: &Mesh, bvh: &Bvh, lights: &[Light], texel: Oriented) -> Vec3 {
    let Oriented { position, normal } = texel;
    let origin = position + normal * OFFSET;
    let mut sum = Vec3::ZERO;
    for light in lights {
        let mut reached = 0.0;
        for &point in &light.points {
            let way = point - origin;
            let square = way.dot(way).max(0.04);
            let direction = way.normalize_or(Vec3::Z);
            let cosine = normal.dot(direction);
            let leaving = light.facing.map_or(1.0, |f| f.dot(-direction).max(0.0));
            if cosine <= 0.0 || leaving <= 0.0 {
                continue;
            }
            let ray = Ray { origin, direction: way };
            let blocks = |i: u32| {
                let patch = mesh.facets[i as usize].patch;
                mesh.patches[patch as usize].material.glow == 0.0
            };
            if !bvh.blocked(&mesh.triangles, &ray, 0.999, blocks) {
                reached += cosine * leaving / square;
            }
        }
        sum += light.power * (reached / light.points.len() as f32);
    }
    sum
}

fn gather(mesh: &Mesh, bvh: &Bvh, direct: &Baked, albedos: &[Vec3], texel: Oriented) -> Vec3 {
    let Oriented { position, normal } = texel;
    let origin = position + normal * OFFSET;
    let x = perpendicular(normal);
    let y = normal.cross(x);
    let mut sum = Vec3::ZERO;
    for i in 0..GATHER {
        // Cosine-weighted: a sunflower on the disc, lifted to the hemisphere.
        let square = (i as f32 + 0.5) / GATHER as f32;
        let (s, c) = (i as f32 * 2.399_963).sin_cos();
        let radius = square.sqrt();
        let direction = x * (radius * c) + y * (radius * s) + normal * (1.0 - square).sqrt();
        let Some(hit) = bvh.nearest(&mesh.triangles, &Ray { origin, direction }) else { continue };
        let facet = &mesh.facets[hit.triangle as usize];
        let uv = facet.uv_at(hit.b1, hit.b2);
        let (patch, albedo) = (facet.patch, albedos[facet.patch as usize]);
        let glow = mesh.patches[patch as usize].material.glow;
        let light = direct.at(mesh, patch, uv) * FRAC_1_PI;
        sum += albedo * (light + Vec3::ONE * (FURTHER_BOUNCES + glow));
    }
    sum * (PI / GATHER as f32)
}

/// A 3 × 3 mean over the light grid: takes the gathering rays' pattern out.
fn smooth(texels: &[Vec3], [columns, rows]: [usize; 2]) -> Vec<Vec3> {
    (0..texels.len())
        .map(|i| {
            let (c, r) = (i % columns, i / columns);
            let mut sum = Vec3::ZERO;
            let mut count = 0.0;
            for y in r.saturating_sub(1)..=(r + 1).min(rows - 1) {
                for x in c.saturating_sub(1)..=(c + 1).min(columns - 1) {
                    sum += texels[y * columns + x];
                    count += 1.0;
                }
            }
            sum * (1.0 / count)
        })
        .collect()
}
