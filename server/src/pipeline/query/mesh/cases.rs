//! The cases of marching cubes (Lorensen and Cline 1987), made instead of typed.
//!
//! A cube's corner `c` lies at `(c & 1, c >> 1 & 1, c >> 2)`; a case is the set of corners inside the
//! surface, bit `c` each. On every face, each run of inside corners is cut off by a segment of its
//! own; a face looks the same from both of its cubes, so neighbours always meet, ambiguous faces
//! included, and surfaces of closed volumes are closed. Segments join to loops, loops to fans.

/// Edges of a cube: 4 along each axis, by their lower corner.
pub(super) const EDGES: [(usize, usize); 12] = edges();
/// Corners of the faces, counter-clockwise as seen from outside.
const FACES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Triangles of every case, as edges; counter-clockwise as seen from outside the surface.
pub(super) struct Cases(Vec<Vec<[usize; 3]>>);

impl Cases {
    /// All 256.
    pub(super) fn new() -> Self {
        Self((0..256).map(triangles).collect())
    }

    /// The triangles of the case.
    pub(super) fn of(&self, inside: u8) -> &[[usize; 3]] {
        &self.0[usize::from(inside)]
    }
}

const fn edges() -> [(usize, usize); 12] {
    let mut found = [(0, 0); 12];
    let (mut at, mut axis) = (0, 0);
    while axis < 3 {
        let mut corner = 0;
        while corner < 8 {
            if corner & (1 << axis) == 0 {
                found[at] = (corner, corner | (1 << axis));
                at += 1;
            }
            corner += 1;
        }
        axis += 1;
    }
    found
}

fn edge_between(a: usize, b: usize) -> usize {
    let ends = (a.min(b), a.max(b));
    EDGES.iter().position(|edge| *edge == ends).expect("neighbours on a face share an edge")
}

fn triangles(inside: usize) -> Vec<[usize; 3]> {
    let is_in = |corner: usize| inside >> corner & 1 == 1;
    // From each cut edge to the next along its loop.
    let mut next = [None; 12];
    for face in FACES {
        for start in 0..4 {
            let (before, first) = (face[(start + 3) % 4], face[start]);
            if is_in(before) || !is_in(first) {
                continue;
            }
            let run = (0..4).take_while(|&i| is_in(face[(start + i) % 4])).count();
            let (last, after) = (face[(start + run - 1) % 4], face[(start + run) % 4]);
            next[edge_between(before, first)] = Some(edge_between(last, after));
        }
    }
    let mut found = Vec::new();
    for start in 0..12 {
        let mut around = Vec::new();
        let mut at = start;
        while let Some(following) = next[at].take() {
            around.push(at);
            at = following;
        }
        found.extend(around.windows(2).skip(1).map(|pair| [around[0], pair[0], pair[1]]));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    /// The directed edges of a case's triangles that no other triangle runs against.
    fn border(triangles: &[[usize; 3]]) -> Vec<(usize, usize)> {
        let mut directed = HashMap::new();
        for triangle in triangles {
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                *directed.entry((triangle[a], triangle[b])).or_insert(0) += 1;
            }
        }
        assert!(directed.values().all(|&count| count == 1), "{triangles:?}");
        directed.keys().filter(|&&(a, b)| !directed.contains_key(&(b, a))).copied().collect()
    }

    fn on_a_face(a: usize, b: usize) -> bool {
        FACES.iter().any(|face| {
            [a, b].iter().all(|&edge| {
                let (low, high) = EDGES[edge];
                face.contains(&low) && face.contains(&high)
            })
        })
    }

    #[test]
    fn every_case_cuts_exactly_the_edges_that_change_sign_and_ends_on_faces() {
        let cases = Cases::new();
        for inside in 0..=255_u8 {
            let triangles = cases.of(inside);
            let mut used: Vec<usize> = triangles.iter().flatten().copied().collect();
            used.sort_unstable();
            used.dedup();
            let is_in = |corner: usize| inside >> corner & 1 == 1;
            let cut: Vec<usize> =
                (0..12).filter(|&at| is_in(EDGES[at].0) != is_in(EDGES[at].1)).collect();
            assert_eq!(used, cut, "case {inside}");
            // Inside the cube triangles meet; the surface ends on the cube's faces only.
            assert!(border(triangles).iter().all(|&(a, b)| on_a_face(a, b)), "case {inside}");
        }
        assert!(cases.of(0).is_empty() && cases.of(255).is_empty());
        assert_eq!(cases.of(1).len(), 1, "a corner is one triangle");
        assert_eq!(cases.of(0b0000_1111).len(), 2, "a half is a square");
        // Two corners across a face: apart, not bridged.
        assert_eq!(cases.of(0b0000_1001).len(), 2);
    }

    #[test]
    fn a_corners_triangle_faces_away_from_it() {
        // Corner 0 inside: the middles of its three edges are at 0.5 along each axis.
        let middle = |edge: usize| {
            let (low, high) = EDGES[edge];
            [0, 1, 2].map(|axis| ((low >> axis & 1) + (high >> axis & 1)) as f32 / 2.0)
        };
        let [a, b, c] = Cases::new().of(1)[0].map(middle).map(nalgebra::Vector3::from);
        let normal = (b - a).cross(&(c - a));
        assert!(normal.iter().all(|&part| part > 0.0), "{normal}");
    }
}
