//! The surface of a field by marching cubes: a vertex per cut edge, shared by its triangles.
//!
//! In: a [`Volume`]. Out: vertices in metres with colors and normals (towards free space), triangles
//! counter-clockwise from outside. A cube with an unknown corner has no surface: what was not seen
//! stays open. Pieces of few triangles are floaters and left out.

use super::Mesh;
use super::cases::{Cases, EDGES};
use super::volume::{SIDE, Volume, Voxel, place};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Pieces of fewer triangles are dropped.
const LEAST_TRIANGLES: usize = 50;

/// A cut edge: its lower corner in voxels, and its axis.
type Edge = ([i32; 3], usize);

/// The surface, without codes.
pub(super) fn extract(volume: &Volume) -> Mesh {
    let cases = Cases::new();
    let pieces: Vec<Vec<[Edge; 3]>> =
        volume.blocks().map(|block| triangles(volume, &cases, block)).collect();
    let mut index: HashMap<Edge, u32> = HashMap::new();
    let (mut edges, mut faces) = (Vec::new(), Vec::new());
    for triangle in pieces.into_iter().flatten() {
        faces.push(triangle.map(|edge| {
            *index.entry(edge).or_insert_with(|| {
                edges.push(edge);
                (edges.len() - 1) as u32
            })
        }));
    }
    let kept = without_floaters(&faces, edges.len());
    let (edges, faces) = compacted(&edges, &kept);
    let (positions, colors): (Vec<_>, Vec<_>) =
        edges.par_iter().map(|edge| vertex(volume, edge)).unzip();
    let normals = normals(&positions, &faces);
    Mesh { positions, normals, colors, faces, ..Mesh::default() }
}

/// The triangles of a block's cubes.
fn triangles(volume: &Volume, cases: &Cases, block: [i32; 3]) -> Vec<[Edge; 3]> {
    let corner = block.map(|i| i * SIDE as i32);
    let distances = with_border(volume, corner);
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

/// Distances of a block and of the next voxels along each axis; NaN: unknown.
fn with_border(volume: &Volume, corner: [i32; 3]) -> Vec<f32> {
    (0..BORDERED * BORDERED * BORDERED)
        .map(|i| [i % BORDERED, i / BORDERED % BORDERED, i / BORDERED / BORDERED])
        .map(|at| volume.voxel(std::array::from_fn(|axis| corner[axis] + at[axis] as i32)))
        .map(|voxel| voxel.map_or(f32::NAN, |voxel| voxel.distance))
        .collect()
}

/// Position and color where the field is zero along an edge.
fn vertex(volume: &Volume, (low, axis): &Edge) -> (Point3<f32>, [f32; 3]) {
    let mut high = *low;
    high[*axis] += 1;
    let [a, b] = [*low, high].map(|at| volume.voxel(at).expect("cut edges have known ends"));
    let share = (a.distance / (a.distance - b.distance)).clamp(0.0, 1.0);
    let metres = volume.voxel_metres();
    let position = place(*low, metres).coords.lerp(&place(high, metres).coords, share);
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

/// The triangles of pieces that are large enough.
fn without_floaters(faces: &[[u32; 3]], vertices: usize) -> Vec<[u32; 3]> {
    let mut parent: Vec<u32> = (0..vertices as u32).collect();
    for [a, b, c] in faces {
        for other in [b, c] {
            let (a, b) = (root(&mut parent, *a), root(&mut parent, *other));
            parent[a as usize] = b;
        }
    }
    let mut sizes = vec![0_usize; vertices];
    for face in faces {
        sizes[root(&mut parent, face[0]) as usize] += 1;
    }
    let large = |face: &&[u32; 3]| sizes[root(&mut parent, face[0]) as usize] >= LEAST_TRIANGLES;
    faces.iter().filter(large).copied().collect()
}

/// The vertex that stands for a piece; paths are halved on the way.
fn root(parent: &mut [u32], mut at: u32) -> u32 {
    while parent[at as usize] != at {
        let above = parent[at as usize];
        parent[at as usize] = parent[above as usize];
        at = parent[at as usize];
    }
    at
}

/// Only the vertices that triangles use, in order.
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
