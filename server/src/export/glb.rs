//! `splats.glb`: binary glTF 2.0 with the extension `KHR_gaussian_splatting`, for viewers on the
//! web.
//!
//! Attributes follow the extension: positions, rotations (x, y, z, w), linear scales in metres,
//! opacities in 0..1 and coefficients of the zeroth spherical harmonic, all float32. Viewers
//! without the extension show points with `COLOR_0`. Values are in the map's world. The node's
//! rotation turns them, so that y is up as glTF demands.

use super::splat::{Splat, byte, splats};
use lexsplat_gpu::HostGaussians;
use nalgebra::UnitQuaternion;
use serde_json::{Value, json};

/// "glTF" in ASCII.
const MAGIC: u32 = 0x4654_6c67;
const VERSION: u32 = 2;
const JSON_CHUNK: u32 = 0x4e4f_534a;
const BINARY_CHUNK: u32 = 0x004e_4942;
/// What a view of the buffer is for: attributes of vertices.
const ARRAY_BUFFER: u32 = 34962;
/// Component type of glTF.
const UNSIGNED_BYTE: u32 = 5121;
/// Component type of glTF.
const FLOAT: u32 = 5126;

/// The color heads as `splats.glb`; `turn` is the rotation of the node. An empty map has a scene without
/// nodes: accessors must not be empty.
pub(super) fn splats_glb(gaussians: &HostGaussians, turn: &UnitQuaternion<f64>) -> Vec<u8> {
    let all: Vec<Splat> = splats(gaussians).collect();
    let mut buffer = Buffer::default();
    let generator = concat!("lexsplat ", env!("CARGO_PKG_VERSION"));
    let asset = json!({"version": "2.0", "generator": generator});
    if all.is_empty() {
        return binary(&json!({"asset": asset, "scene": 0, "scenes": [{"nodes": []}]}), &[]);
    }
    let attributes = attributes(&all, &mut buffer);
    let splatting = json!({
        "kernel": "ellipse",
        "colorSpace": "srgb_rec709_display",
        "projection": "perspective",
        "sortingMethod": "cameraDistance",
    });
    let document = json!({
        "asset": asset,
        "extensionsUsed": ["KHR_gaussian_splatting"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "rotation": [turn.i, turn.j, turn.k, turn.w]}],
        "meshes": [{"primitives": [{
            "mode": 0,
            "attributes": attributes,
            "extensions": {"KHR_gaussian_splatting": splatting},
        }]}],
        "buffers": [{"byteLength": buffer.bytes.len()}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    });
    binary(&document, &buffer.bytes)
}

fn attributes(all: &[Splat], buffer: &mut Buffer) -> Value {
    let [mut min, mut max] = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for splat in all {
        for axis in 0..3 {
            min[axis] = min[axis].min(splat.position[axis]);
            max[axis] = max[axis].max(splat.position[axis]);
        }
    }
    let position = buffer.floats(all, "VEC3", |splat| splat.position);
    buffer.accessors[position]["min"] = json!(min);
    buffer.accessors[position]["max"] = json!(max);
    let color = |splat: &Splat| {
        let [red, green, blue] = splat.rgb.map(|value| byte(linear(value.clamp(0.0, 1.0))));
        [red, green, blue, byte(splat.opacity())]
    };
    json!({
        "POSITION": position,
        "KHR_gaussian_splatting:ROTATION": buffer.floats(all, "VEC4", |splat| {
            let [w, x, y, z] = splat.rotation;
            [x, y, z, w]
        }),
        "KHR_gaussian_splatting:SCALE":
            buffer.floats(all, "VEC3", |splat| splat.log_scale.map(f32::exp)),
        "KHR_gaussian_splatting:OPACITY": buffer.floats(all, "SCALAR", |s| [s.opacity()]),
        "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0": buffer.floats(all, "VEC3", Splat::harmonics),
        "COLOR_0": buffer.accessor(
            all.iter().flat_map(color).collect(),
            json!({"componentType": UNSIGNED_BYTE, "normalized": true, "count": all.len(), "type": "VEC4"}),
        ),
    })
}

/// From sRGB (IEC 61966-2-1) to linear light, as `COLOR_0` requires.
fn linear(value: f32) -> f32 {
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// The binary chunk and the arrays in it.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    /// Appends a float32 array; returns the index of its accessor.
    fn floats<const N: usize>(
        &mut self,
        all: &[Splat],
        kind: &str,
        value: impl Fn(&Splat) -> [f32; N],
    ) -> usize {
        let bytes = all.iter().flat_map(value).flat_map(f32::to_le_bytes).collect();
        self.accessor(bytes, json!({"componentType": FLOAT, "count": all.len(), "type": kind}))
    }

    /// Appends an array as a view of its own; returns the index of its accessor. The length is a
    /// multiple of four bytes.
    fn accessor(&mut self, bytes: Vec<u8>, mut accessor: Value) -> usize {
        self.views
            .push(json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len(), "target": ARRAY_BUFFER}));
        accessor["bufferView"] = json!(self.views.len() - 1);
        self.accessors.push(accessor);
        self.bytes.extend(bytes);
        self.accessors.len() - 1
    }
}

/// The file: header and chunks. JSON is padded with spaces.
fn binary(document: &Value, buffer: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut chunks = vec![(JSON_CHUNK, &text[..])];
    if !buffer.is_empty() {
        chunks.push((BINARY_CHUNK, buffer));
    }
    let total = 12 + chunks.iter().map(|(_, data)| 8 + data.len()).sum::<usize>();
    let word = |number: usize| u32::try_from(number).expect("a map is less than 4 GiB");
    let mut out = Vec::with_capacity(total);
    for number in [MAGIC, VERSION, word(total)] {
        out.extend(number.to_le_bytes());
    }
    for (kind, data) in chunks {
        out.extend(word(data.len()).to_le_bytes());
        out.extend(kind.to_le_bytes());
        out.extend(data);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::splat::samples::two;

    fn parts(file: &[u8]) -> (Value, &[u8]) {
        let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
        assert_eq!((word(0), word(4), word(8) as usize), (MAGIC, VERSION, file.len()));
        let length = word(12) as usize;
        assert_eq!((word(16), length % 4), (JSON_CHUNK, 0));
        let document = serde_json::from_slice(&file[20..20 + length]).unwrap();
        (document, file.get(20 + length + 8..).unwrap_or_default())
    }

    #[test]
    fn attributes_have_the_extensions_names_and_values() {
        let turn = UnitQuaternion::from_euler_angles(0.2, 0.5, -0.1);
        let file = splats_glb(&two(), &turn);
        let (document, data) = parts(&file);
        assert_eq!(document["nodes"][0]["rotation"], json!(turn.coords.as_slice()), "x, y, z, w");
        let primitive = &document["meshes"][0]["primitives"][0];
        assert_eq!(document["buffers"][0]["byteLength"], data.len());
        let floats = |name: &str| -> Vec<f32> {
            let accessor =
                &document["accessors"][primitive["attributes"][name].as_u64().unwrap() as usize];
            assert_eq!((&accessor["count"], &accessor["componentType"]), (&json!(2), &json!(5126)));
            let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
            let at = view["byteOffset"].as_u64().unwrap() as usize;
            data[at..at + view["byteLength"].as_u64().unwrap() as usize]
                .chunks_exact(4)
                .map(|four| f32::from_le_bytes(four.try_into().unwrap()))
                .collect()
        };
        assert_eq!(floats("POSITION"), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(floats("KHR_gaussian_splatting:ROTATION")[4..], [0.6, 0.0, 0.8, 0.0]);
        // Linear, not logarithms.
        assert_eq!(floats("KHR_gaussian_splatting:SCALE")[0], (-1.0_f32).exp());
        assert!((floats("KHR_gaussian_splatting:OPACITY")[0] - 0.562_177).abs() < 1e-5);
        assert!((floats("KHR_gaussian_splatting:SH_DEGREE_0_COEF_0")[0] - 1.772_45).abs() < 1e-4);
        assert_eq!(document["accessors"][0]["max"], json!([4.0, 5.0, 6.0]));
        // sRGB 1.0, 0.5, 0.0 as linear light.
        assert_eq!(data[data.len() - 8..][..4], [255, 55, 0, 143]);
    }

    #[test]
    fn an_empty_map_is_an_empty_scene() {
        let file = splats_glb(&HostGaussians::default(), &UnitQuaternion::identity());
        let (document, data) = parts(&file);
        assert!(data.is_empty() && document.get("accessors").is_none(), "{document}");
    }
}
