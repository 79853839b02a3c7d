//! Rendering a view. One ray through each pixel centre gives exact depth and instance ids. Color is
//! the mean of four samples per pixel: traced next to edges, taken from the hit surface elsewhere.

use crate::bvh::{Hit, Ray, plane_hit};
use crate::camera::{Camera, View};
use crate::light::Baked;
use crate::mesh::Oriented;
use crate::scene::{Highlight, Scene};
use crate::surface::SurfacePoint;
use crate::vector::luminance;
use glam::{Vec3, vec3};
use nalgebra::Isometry3;
use rayon::prelude::*;

/// Camera axes in the world, for rays.
struct Eye<'a> {
    camera: &'a Camera,
    origin: Vec3,
    axes: [Vec3; 3],
}

impl<'a> Eye<'a> {
    fn new(camera: &'a Camera, pose: &Isometry3<f64>) -> Self {
        let rotation = pose.rotation.to_rotation_matrix();
        let column = |i: usize| {
            let c = rotation.matrix().column(i).into_owned();
            vec3(c[0] as f32, c[1] as f32, c[2] as f32)
        };
        let t = pose.translation.vector;
        Self {
            camera,
            origin: vec3(t.x as f32, t.y as f32, t.z as f32),
            axes: [column(0), column(1), column(2)],
        }
    }

    /// The ray through image point (x, y); its direction has camera z = 1, so distance is depth.
    #[inline]
    fn ray(&self, x: f32, y: f32) -> Ray {
        let c = self.camera;
        let (dx, dy) = ((x - c.cx as f32) / c.fx as f32, (y - c.cy as f32) / c.fy as f32);
        let direction = self.axes[0] * dx + self.axes[1] * dy + self.axes[2];
        Ray { origin: self.origin, direction }
    }
}

/// Offsets of the four color samples from the pixel's centre.
const SAMPLES: [(f32, f32); 4] =
    [(-0.125, -0.375), (0.375, -0.125), (-0.375, 0.125), (0.125, 0.375)];
/// Neighbouring normals further apart than this (cosine) count as an edge.
const EDGE: f32 = 0.9;

/// Renders one view of the scene.
pub(crate) fn render(scene: &Scene, camera: &Camera, pose: &Isometry3<f64>) -> View {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let eye = Eye::new(camera, pose);
    let baked = scene.baked();
    let mesh = &scene.mesh;
    let hits: Vec<Option<Hit>> = (0..width * height)
        .into_par_iter()
        .with_min_len(width)
        .map(|i| {
            let ray = eye.ray((i % width) as f32, (i / width) as f32);
            scene.bvh.nearest(&mesh.triangles, &ray)
        })
        .collect();
    let rgb: Vec<[u8; 3]> = (0..width * height)
        .into_par_iter()
        .with_min_len(width)
        .map(|i| {
            let edge = is_edge(scene, &hits, i, width);
            let mut sum = Vec3::ZERO;
            for (dx, dy) in SAMPLES {
                let ray = eye.ray((i % width) as f32 + dx, (i / width) as f32 + dy);
                let hit = match &hits[i] {
                    Some(hit) if !edge => {
                        plane_hit(&mesh.triangles[hit.triangle as usize], hit.triangle, &ray)
                    }
                    _ => scene.bvh.nearest(&mesh.triangles, &ray),
                };
                sum += hit.map_or(Vec3::ZERO, |hit| display(shade(scene, baked, &ray, &hit)));
            }
            encode(sum * 0.25)
        })
        .collect();
    let instance = |h: &Hit| mesh.patches[mesh.facets[h.triangle as usize].patch as usize].instance;
    View {
        width: camera.width,
        height: camera.height,
        rgb: rgb.into_flattened(),
        depth: hits.iter().map(|h| h.map_or(0.0, |h| h.distance)).collect(),
        instances: hits.iter().map(|h| h.as_ref().map_or(0, instance)).collect(),
    }
}

/// Whether a pixel's neighbours (left, right, up, down) lie on another surface or another side.
fn is_edge(scene: &Scene, hits: &[Option<Hit>], i: usize, width: usize) -> bool {
    let facet = |h: &Hit| &scene.mesh.facets[h.triangle as usize];
    let Some(own) = &hits[i] else { return true };
    let normal = facet(own).normal_at(own.b1, own.b2);
    let (x, y) = (i % width, i / width);
    let neighbours = [
        (x > 0).then(|| i - 1),
        (x + 1 < width).then(|| i + 1),
        (y > 0).then(|| i - width),
        (i + width < hits.len()).then(|| i + width),
    ];
    neighbours.into_iter().flatten().any(|n| match &hits[n] {
        None => true,
        Some(other) => {
            facet(other).patch != facet(own).patch
                || facet(other).normal_at(other.b1, other.b2).dot(normal) < EDGE
        }
    })
}

/// Radiance towards the eye, linear RGB.
fn shade(scene: &Scene, baked: &Baked, ray: &Ray, hit: &Hit) -> Vec3 {
    let facet = &scene.mesh.facets[hit.triangle as usize];
    let patch = &scene.mesh.patches[facet.patch as usize];
    let uv = facet.uv_at(hit.b1, hit.b2);
    let position = ray.origin + ray.direction * hit.distance;
    let metres = [uv[0] * patch.metres[0], uv[1] * patch.metres[1]];
    let at = SurfacePoint { uv, metres, local: patch.placement.inverse_point(position) };
    let material = &patch.material;
    let albedo = material.texture.albedo(&at);
    let light = baked.at(&scene.mesh, facet.patch, uv);
    let mut color = albedo * light * std::f32::consts::FRAC_1_PI + albedo * material.glow;
    if material.gloss > 0.0 {
        let normal = facet.normal_at(hit.b1, hit.b2);
        let towards = -ray.direction.normalize_or(Vec3::Z);
        let normal = if normal.dot(towards) < 0.0 { -normal } else { normal };
        color += highlight(scene, material.gloss, Oriented { position, normal }, towards, light);
    }
    color
}

/// Blinn–Phong highlights of the lights, and a grazing sheen of the room's mean light.
fn highlight(scene: &Scene, gloss: f32, at: Oriented, towards: Vec3, light: Vec3) -> Vec3 {
    let Oriented { position, normal } = at;
    let exponent = 12.0 + 110.0 * gloss * gloss;
    let mut sum = Vec3::ZERO;
    for Highlight { centre, power } in &scene.highlights {
        let way = *centre - position;
        let half = (way.normalize_or(Vec3::Z) + towards).normalize_or(Vec3::Z);
        let lobe = normal.dot(half).max(0.0).powf(exponent) * (exponent + 2.0) * 0.02;
        sum += *power * (lobe / way.dot(way).max(0.25));
    }
    // The highlight is shadowed like the diffuse light at the same place.
    let shadow = (luminance(light) * 0.4).min(1.0);
    let grazing = (1.0 - normal.dot(towards).clamp(0.0, 1.0)).powi(5);
    (sum * 0.12 * gloss + Vec3::ONE * (0.25 * gloss * grazing)) * shadow
}

/// Tone curve: linear radiance to display-linear 0..1, with a soft shoulder.
fn display(c: Vec3) -> Vec3 {
    const EXPOSURE: f32 = 1.15;
    let curve = |x: f32| {
        let x = x.max(0.0) * EXPOSURE;
        if x < 0.6 { x } else { 0.6 + 0.4 * (1.0 - (-(x - 0.6) / 0.4).exp()) }
    };
    vec3(curve(c.x), curve(c.y), curve(c.z))
}

/// Display-linear to sRGB bytes.
fn encode(c: Vec3) -> [u8; 3] {
    [c.x, c.y, c.z].map(|x| {
        let s = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        (s * 255.0 + 0.5).clamp(0.0, 255.0) as u8
    })
}
