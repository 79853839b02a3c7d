//! `mesh.ply`: binary little-endian PLY.
//!
//! Properties of the vertices: `x y z nx ny nz red green blue`, `code_0 ...` of the online stage,
//! and `relevancy` if there is a query. Viewers ignore unknown properties.

use super::ply;
use super::splat::byte;
use crate::pipeline::query::Mesh;

/// Vertices of a face.
const CORNERS: u8 = 3;

/// The mesh as PLY.
pub(super) fn mesh_ply(mesh: &Mesh) -> Vec<u8> {
    let size = if mesh.positions.is_empty() { 0 } else { mesh.code_size };
    let codes: Vec<String> = (0..size).map(|at| format!("code_{at}")).collect();
    let mut floats: Vec<&str> = codes.iter().map(String::as_str).collect();
    if !mesh.relevancies.is_empty() {
        floats.push("relevancy");
    }
    let properties: [(&str, &[&str]); 3] = [
        ("float", &["x", "y", "z", "nx", "ny", "nz"]),
        ("uchar", &["red", "green", "blue"]),
        ("float", &floats),
    ];
    let mut out = ply::header(mesh.positions.len(), &properties, Some(mesh.faces.len()));
    for (at, position) in mesh.positions.iter().enumerate() {
        ply::put(&mut out, position.coords.as_slice());
        ply::put(&mut out, mesh.normals[at].as_slice());
        out.extend(mesh.colors[at].map(byte));
        ply::put(&mut out, &mesh.codes[at * size..][..size]);
        ply::put(&mut out, mesh.relevancies.get(at..=at).unwrap_or_default());
    }
    for face in &mesh.faces {
        out.push(CORNERS);
        out.extend(face.iter().flat_map(|corner| corner.to_le_bytes()));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Vector3};

    #[test]
    fn vertices_and_faces_follow_the_header() {
        let mut mesh = Mesh {
            positions: [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]].map(Point3::from).into(),
            normals: vec![Vector3::z(); 3],
            colors: vec![[1.0, 0.5, 0.0]; 3],
            codes: vec![0.25; 6],
            code_size: 2,
            relevancies: vec![0.1, 0.2, 0.3],
            faces: vec![[0, 1, 2]],
        };
        let file = mesh_ply(&mesh);
        let end = file.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&file[..end]).unwrap();
        assert!(header.contains("element vertex 3\n"), "{header}");
        assert!(header.contains("property float code_1\nproperty float relevancy\n"), "{header}");
        assert!(
            header
                .ends_with("element face 1\nproperty list uchar int vertex_indices\nend_header\n"),
            "{header}"
        );
        let row = 6 * 4 + 3 + 3 * 4;
        assert_eq!(file.len(), end + 3 * row + 13);
        assert_eq!(file[end + 24..end + 27], [255, 128, 0]);
        assert_eq!(file[end + row - 4..end + row], 0.1_f32.to_le_bytes());
        assert_eq!(file[file.len() - 13..][..5], [3, 0, 0, 0, 0]);
        // Without a question there is no relevancy.
        mesh.relevancies.clear();
        assert_eq!(mesh_ply(&mesh).len(), file.len() - "property float relevancy\n".len() - 3 * 4);
    }
}
