//! The surface of a TSDF by marching cubes: a vertex for each cut edge, shared by its triangles.
//!
//! In: a [`Tsdf`]. Out: vertices in metres with colors and normals (towards free space), triangles
//! counter-clockwise as seen from outside. A cube with an unknown corner has no surface, so that
//! unobserved space stays open. Connected components of few triangles are dropped as noise.

use super::cases::{Cases, EDGES};
use super::triangles::Mesh;
use super::tsdf::{SIDE, Tsdf, Voxel, voxel_position};
use crate::pipeline::query::disjoint_sets::DisjointSets;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Components of fewer triangles are dropped.
const MIN_TRIANGLES: usize = 50;

/// A cut edge: its lower corner in voxels, and its axis.
type Edge = ([i32; 3], usize);

/// The surface, without codes.
pub(super) fn extract(tsdf: &Tsdf) -> Mesh {
    let cases = Cases::new();
    let blocks: Vec<Vec<[Edge; 3]>> =
        tsdf.blocks().map(|block| triangles(tsdf, &cases, block)).collect();
    let mut index: HashMap<Edge, u32> = HashMap::new();
    let (mut edges, mut faces) = (Vec::new(), Vec::new());
    for triangle in blocks.into_iter().flatten() {
        faces.push(triangle.map(|edge| {
            *index.entry(edge).or_insert_with(|| {
                edges.push(edge);
                (edges.len() - 1) as u32
            })
        }));
    }
    let kept = without_small_components(&faces, edges.len());
    let (edges, faces) = compacted(&edges, &kept);
    let (positions, colors): (Vec<_>, Vec<_>) =
        edges.par_iter().map(|edge| vertex(tsdf, edge)).unzip();
    let normals = normals(&positions, &faces);
    Mesh { positions, normals, colors, faces, ..Mesh::default() }
}

/// The triangles of a block's cubes.
fn triangles(tsdf: &Tsdf, cases: &Cases, block: [i32; 3]) -> Vec<[Edge; 3]> {
    let corner = block.map(|i| i * SIDE as i32);
    let distances = with_border(tsdf, corner);
    let mut found = Vec::new();
    for cube in 0..SIDE * SIDE * SIDE {
        let at = [cube % SIDE, cube / SIDE % SIDE, cube / SIDE / SIDE];
        let mut inside = 0_u8;
        let known = (0..8).all(|c| {
            let distance = distances[index(std::array::from_fn(|axis| at[axis] + (c >> axis & 1)))];
            inside |= u8::from(distance < 0.0) << c;
            !distance.is_nan()
        });
        if !known {
            continue;
        }
        let edge = |edge: usize| {
            let (low, high) = EDGES[edge];
            let start = |axis: usize| corner[axis] + (at[axis] + (low >> axis & 1)) as i32;
            (std::array::from_fn(start), (low ^ high).trailing_zeros() as usize)
        };
        found.extend(cases.of(inside).iter().map(|triangle| triangle.map(edge)));
    }
    found
}

const BORDERED: usize = SIDE + 1;

fn index([x, y, z]: [usize; 3]) -> usize {
    (z * BORDERED + y) * BORDERED + x
}

/// Distances of a block and of the adjacent voxels along each axis; NaN: unknown.
fn with_border(tsdf: &Tsdf, corner: [i32; 3]) -> Vec<f32> {
    (0..BORDERED * BORDERED * BORDERED)
        .map(|i| [i % BORDERED, i / BORDERED % BORDERED, i / BORDERED / BORDERED])
        .map(|at| tsdf.voxel(std::array::from_fn(|axis| corner[axis] + at[axis] as i32)))
        .map(|voxel| voxel.map_or(f32::NAN, |voxel| voxel.distance))
        .collect()
}

/// Position and color of the zero of the distance along an edge.
fn vertex(tsdf: &Tsdf, (low, axis): &Edge) -> (Point3<f32>, [f32; 3]) {
    let mut high = *low;
    high[*axis] += 1;
    let [a, b] = [*low, high].map(|at| tsdf.voxel(at).expect("cut edges have known ends"));
    let share = (a.distance / (a.distance - b.distance)).clamp(0.0, 1.0);
    let metres = tsdf.voxel_metres();
    let position =
        voxel_position(*low, metres).coords.lerp(&voxel_position(high, metres).coords, share);
    (Point3::from(position), mixed(a, b, share))
}

fn mixed(a: &Voxel, b: &Voxel, share: f32) -> [f32; 3] {
    match (a.colored > 0.0, b.colored > 0.0) {
        (true, true) => std::array::from_fn(|i| a.rgb[i] + (b.rgb[i] - a.rgb[i]) * share),
        (true, false) => a.rgb,
        _ => b.rgb,
    }
}

/// Means of the triangles' normals, weighted by their areas.
fn normals(positions: &[Point3<f32>], faces: &[[u32; 3]]) -> Vec<Vector3<f32>> {
    let mut sums = vec![Vector3::zeros(); positions.len()];
    for face in faces {
        let [a, b, c] = face.map(|at| positions[at as usize]);
        let normal = (b - a).cross(&(c - a));
        for at in face {
            sums[*at as usize] += normal;
        }
    }
    sums.into_iter().map(|sum| sum.try_normalize(0.0).unwrap_or_else(Vector3::z)).collect()
}

/// The triangles of connected components that are large enough.
fn without_small_components(faces: &[[u32; 3]], vertices: usize) -> Vec<[u32; 3]> {
    let mut components = DisjointSets::new(vertices);
    for [a, b, c] in faces {
        components.join(*a as usize, *b as usize);
        components.join(*a as usize, *c as usize);
    }
    let mut sizes = vec![0_usize; vertices];
    for face in faces {
        sizes[components.representative(face[0] as usize)] += 1;
    }
    let is_large =
        |face: &&[u32; 3]| sizes[components.representative(face[0] as usize)] >= MIN_TRIANGLES;
    faces.iter().filter(is_large).copied().collect()
}

/// The vertices that triangles use, in order, and the renumbered triangles.
fn compacted(edges: &[Edge], faces: &[[u32; 3]]) -> (Vec<Edge>, Vec<[u32; 3]>) {
    let mut renamed = vec![None; edges.len()];
    let mut used = Vec::new();
    let faces = faces
        .iter()
        .map(|face| {
            face.map(|at| {
                *renamed[at as usize].get_or_insert_with(|| {
                    used.push(edges[at as usize]);
                    (used.len() - 1) as u32
                })
            })
        })
        .collect();
    (used, faces)
}
