//! `language.npz`: the language beside `splats.ply`, one row per Gaussian in the same order.
//!
//! NumPy's archive, because `numpy.load` is all that is needed to read it, and arrays of different
//! shapes are one file (safetensors needs a package, loose .npy files a folder). Holds:
//! `codes` `[n, code_size]` of the online stage, zeros where nothing was said yet; `generic` `[n, 32]`, the
//! same decoded by the online stage, unit length, zeros alike: with the bundle's decoder (`decompress.onnx`
//! under `models/`) they become features that embedded words are compared with; and the language
//! heads' shapes: `opacity` `[n]` in 0..1, `log_scale` `[n, 3]`, `rotation` `[n, 4]` (w, x, y, z). Decoding
//! every Gaussian once costs less than telling users of every kind of online stage apart.

use super::npy;
use crate::pipeline::compressor::GENERIC;
use crate::pipeline::snapshot::MapSnapshot;
use std::io::{Cursor, Write as _};
use zip::CompressionMethod;
use zip::write::{SimpleFileOptions, ZipWriter};

/// The language heads' codes and shapes.
pub(super) fn language_npz(snapshot: &MapSnapshot) -> Vec<u8> {
    let head = &snapshot.gaussians.language;
    let (count, size) = (snapshot.gaussians.len(), snapshot.online.code_size());
    let mut generic = snapshot.online.decode(&head.features);
    for (code, decoded) in head.features.chunks_exact(size).zip(generic.chunks_exact_mut(GENERIC)) {
        if code.iter().all(|&value| value == 0.0) {
            decoded.fill(0.0);
        }
    }
    let opacity: Vec<f32> =
        head.opacity_logits.iter().map(|logit| 1.0 / (1.0 + (-logit).exp())).collect();
    archive(&[
        ("codes", npy(&[count, size], &head.features)),
        ("generic", npy(&[count, GENERIC], &generic)),
        ("opacity", npy(&[count], &opacity)),
        ("log_scale", npy(&[count, 3], head.log_scales.as_flattened())),
        ("rotation", npy(&[count, 4], head.rotations.as_flattened())),
    ])
}

fn archive(arrays: &[(&str, Vec<u8>)]) -> Vec<u8> {
    // Stored: codes do not compress, and NumPy reads both.
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, array) in arrays {
        zip.start_file(format!("{name}.npy"), options).expect("names differ");
        zip.write_all(array).expect("memory takes all bytes");
    }
    zip.finish().expect("memory takes all bytes").into_inner()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::splat::samples::two;
    use crate::pipeline::compressor::{CompressorConfig, online};
    use std::io::Read as _;
    use std::sync::Arc;

    #[test]
    fn arrays_are_named_and_rows_without_language_are_zeros() {
        let mut gaussians = two();
        gaussians.language.features[15..].fill(0.0);
        let mut stage = online(&CompressorConfig::default());
        let seen: Vec<f32> = (0..64 * GENERIC).map(|i| ((i * 37 % 101) as f32).sin()).collect();
        stage.observe(&seen);
        let snapshot = MapSnapshot {
            map: "room".into(),
            revision: 1,
            gaussians: Arc::new(gaussians),
            online: stage.into(),
            intrinsics: None,
            trajectory: Arc::default(),
            keyframes: Arc::default(),
        };
        let mut zip = zip::ZipArchive::new(Cursor::new(language_npz(&snapshot))).unwrap();
        let mut names: Vec<String> =
            zip.file_names().map(|name| name.unwrap().into_owned()).collect();
        names.sort();
        let expected = ["codes", "generic", "log_scale", "opacity", "rotation"];
        assert_eq!(names, expected.map(|name| format!("{name}.npy")));
        let mut file = Vec::new();
        zip.by_name("generic.npy").unwrap().read_to_end(&mut file).unwrap();
        assert!(String::from_utf8_lossy(&file[..128]).contains("(2, 32)"));
        let rows: Vec<f32> = file[file.len() - 2 * GENERIC * 4..]
            .chunks_exact(4)
            .map(|four| f32::from_le_bytes(four.try_into().unwrap()))
            .collect();
        let length = |row: &[f32]| row.iter().map(|value| value * value).sum::<f32>();
        assert!((length(&rows[..GENERIC]) - 1.0).abs() < 1e-4, "{rows:?}");
        assert_eq!(length(&rows[GENERIC..]), 0.0);
    }
}
