//! The table of marching cubes (Lorensen and Cline 1987), computed instead of listed.
//!
//! Corner `c` of a cube lies at `(c & 1, c >> 1 & 1, c >> 2)`. A case is the set of corners inside
//! the surface, one bit for each. On each face, a segment separates each run of adjacent inside
//! corners. Both cubes of a face have the same segments, also on ambiguous faces, so that the
//! surface of a closed volume is closed. Segments are joined to loops, and loops are triangulated
//! as fans.

/// The edges of a cube as pairs of corners: 4 along each axis.
pub(super) const EDGES: [(usize, usize); 12] = edges();
/// Corners of the faces, counter-clockwise as seen from outside.
const FACES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// The triangles of each case, as edge indices; counter-clockwise as seen from outside the surface.
pub(super) struct Cases(Vec<Vec<[usize; 3]>>);

impl Cases {
    /// Computes all 256 cases.
    pub(super) fn new() -> Self {
        Self((0..256).map(triangles).collect())
    }

    /// The triangles of a case.
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
    // For each cut edge the next one along its loop.
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

    /// The directed edges of a case's triangles without an opposite edge of another triangle.
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
    fn triangles_use_exactly_the_edges_that_change_sign_and_end_on_faces() {
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
            // Triangles are connected; the surface ends only on the faces of the cube.
            assert!(border(triangles).iter().all(|&(a, b)| on_a_face(a, b)), "case {inside}");
        }
        assert!(cases.of(0).is_empty() && cases.of(255).is_empty());
        assert_eq!(cases.of(1).len(), 1, "one corner has one triangle");
        assert_eq!(cases.of(0b0000_1111).len(), 2, "half a cube has a square");
        // Two opposite corners of a face have separate triangles.
        assert_eq!(cases.of(0b0000_1001).len(), 2);
    }

    #[test]
    fn the_triangle_of_a_corner_faces_away_from_it() {
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
