//! Binary little-endian PLY: splats, points and scored points.

use super::splat::{byte, splats};
use crate::pipeline::query::ScoredPoint;
use lexsplat_gpu::HostGaussians;

/// Properties of a splat, in the order that viewers expect.
const SPLAT_PROPERTIES: [&str; 17] = [
    "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1",
    "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
];

/// A PLY header: types and names of the vertices' properties, and the number of faces of a mesh.
pub(super) fn header(
    count: usize,
    properties: &[(&str, &[&str])],
    faces: Option<usize>,
) -> Vec<u8> {
    let mut text = format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n");
    for (kind, names) in properties {
        for name in *names {
            text.push_str(&format!("property {kind} {name}\n"));
        }
    }
    if let Some(faces) = faces {
        text.push_str(&format!("element face {faces}\nproperty list uchar int vertex_indices\n"));
    }
    text.push_str("end_header\n");
    text.into_bytes()
}

/// Appends float32 values.
pub(super) fn put(out: &mut Vec<u8>, values: &[f32]) {
    out.extend(values.iter().flat_map(|value| value.to_le_bytes()));
}

/// The color heads as `splats.ply`: logarithmic scales, opacity logits, unit quaternions (w, x, y,
/// z) and `f_dc = (rgb - 0.5) / 0.28209`.
pub(super) fn splats_ply(gaussians: &HostGaussians) -> Vec<u8> {
    let all = splats(gaussians);
    let mut out = header(all.len(), &[("float", &SPLAT_PROPERTIES)], None);
    for splat in all {
        put(&mut out, &splat.position);
        put(&mut out, &[0.0; 3]);
        put(&mut out, &splat.harmonics());
        put(&mut out, &[splat.opacity_logit]);
        put(&mut out, &splat.log_scale);
        put(&mut out, &splat.rotation);
    }
    out
}

/// The centres of the Gaussians with 8-bit colors, `points.ply`.
pub(super) fn points_ply(gaussians: &HostGaussians) -> Vec<u8> {
    let all = splats(gaussians);
    let properties: [(&str, &[&str]); 2] =
        [("float", &["x", "y", "z"]), ("uchar", &["red", "green", "blue"])];
    let mut out = header(all.len(), &properties, None);
    for splat in all {
        put(&mut out, &splat.position);
        out.extend(splat.rgb.map(byte));
    }
    out
}

/// Points of an answer as PLY: `x y z score`.
pub fn scored_points_ply(points: &[ScoredPoint]) -> Vec<u8> {
    let mut out = header(points.len(), &[("float", &["x", "y", "z", "score"])], None);
    for point in points {
        put(&mut out, &[point.position.x, point.position.y, point.position.z, point.score]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::splat::samples::two;
    use nalgebra::Point3;

    fn body(file: &[u8]) -> (&str, &[u8]) {
        let end = file.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
        (std::str::from_utf8(&file[..end]).unwrap(), &file[end..])
    }

    fn floats(data: &[u8]) -> Vec<f32> {
        data.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect()
    }

    #[test]
    fn splats_have_the_properties_of_viewers() {
        let file = splats_ply(&two());
        let (header, data) = body(&file);
        assert!(header.contains("element vertex 2\nproperty float x\n"), "{header}");
        assert!(header.contains("property float rot_3\nend_header\n"), "{header}");
        assert_eq!(data.len(), 2 * 17 * 4);
        let row = floats(&data[..17 * 4]);
        assert_eq!(row[..6], [1.0, 2.0, 3.0, 0.0, 0.0, 0.0]);
        assert!(
            (row[6] - 1.772_45).abs() < 1e-4 && row[7] == 0.0 && (row[8] + 1.772_45).abs() < 1e-4
        );
        assert_eq!(row[9..13], [0.25, -1.0, -2.0, -3.0]);
        assert_eq!(row[13..], [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(floats(&data[17 * 4..])[13..], [0.0, 0.6, 0.0, 0.8]);
    }

    #[test]
    fn points_have_clamped_colors() {
        let file = points_ply(&two());
        let (header, data) = body(&file);
        assert!(header.contains("property uchar blue"), "{header}");
        assert_eq!(data.len(), 2 * 15);
        assert_eq!(data[12..15], [255, 128, 0]);
        assert_eq!(data[27..30], [51, 102, 255]);
    }

    #[test]
    fn scored_points_have_four_floats() {
        let point = ScoredPoint { position: Point3::new(1.0, -2.0, 3.5), score: 0.75 };
        let file = scored_points_ply(&[point]);
        let (header, data) = body(&file);
        assert!(header.contains("property float score"), "{header}");
        assert_eq!(floats(data), [1.0, -2.0, 3.5, 0.75]);
    }
}
