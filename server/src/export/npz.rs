//! `language.npz`: the language heads, one row per Gaussian in the order of `splats.ply`.
//!
//! The file is an archive of NumPy arrays, because `numpy.load` alone reads it and arrays of
//! several shapes fit into one file. All arrays are float32:
//!
//! - `codes` `[n, code_size]`: codes of the online stage; zeros where a Gaussian has no language.
//! - `generic` `[n, 32]`: the same codes decoded by the online stage, unit length; zeros likewise.
//!   The bundle's decoder (`decompress.onnx`) turns them into features. They are stored so that
//!   readers need no implementation of the online stages.
//! - `opacity` `[n]`: 0..1.
//! - `log_scale` `[n, 3]`: natural logarithms of the standard deviations, metres.
//! - `rotation` `[n, 4]`: quaternions (w, x, y, z).
//! - `views` `[n]`: number of keyframes with language that show the Gaussian.
//! - `spread` `[n]`: how far their codes are from the map's: sqrt(1 - mean cosine), drawn towards the
//!   mean of the map, at least 0.2, where views are few.

use super::npy;
use crate::pipeline::compressor::GENERIC_SIZE;
use crate::pipeline::evidence::Sightings;
use crate::pipeline::snapshot::MapSnapshot;
use std::io::{Cursor, Write as _};
use zip::CompressionMethod;
use zip::write::{SimpleFileOptions, ZipWriter};

/// Bytes of `language.npz`.
pub(super) fn language_npz(snapshot: &MapSnapshot) -> Vec<u8> {
    let head = &snapshot.gaussians.language;
    let (count, size) = (snapshot.gaussians.len(), snapshot.online.code_size());
    let mut generic = snapshot.online.decode(&head.features);
    for (code, decoded) in
        head.features.chunks_exact(size).zip(generic.chunks_exact_mut(GENERIC_SIZE))
    {
        if code.iter().all(|&value| value == 0.0) {
            decoded.fill(0.0);
        }
    }
    let opacity: Vec<f32> =
        head.opacity_logits.iter().map(|logit| 1.0 / (1.0 + (-logit).exp())).collect();
    let seen = |value: fn(&Sightings) -> f32| -> Vec<f32> {
        snapshot.sightings().iter().map(value).collect()
    };
    archive(&[
        ("codes", npy(&[count, size], &head.features)),
        ("generic", npy(&[count, GENERIC_SIZE], &generic)),
        ("opacity", npy(&[count], &opacity)),
        ("log_scale", npy(&[count, 3], head.log_scales.as_flattened())),
        ("rotation", npy(&[count, 4], head.rotations.as_flattened())),
        ("views", npy(&[count], &seen(|one| one.views as f32))),
        ("spread", npy(&[count], &seen(|one| one.spread))),
    ])
}

fn archive(arrays: &[(&str, Vec<u8>)]) -> Vec<u8> {
    // Not compressed: codes hardly get smaller.
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, array) in arrays {
        zip.start_file(format!("{name}.npy"), options).expect("the names are distinct");
        zip.write_all(array).expect("a vector takes all bytes");
    }
    zip.finish().expect("a vector takes all bytes").into_inner()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::splat::samples::two;
    use crate::pipeline::compressor::{CompressorConfig, online};
    use std::sync::Arc;

    #[test]
    fn arrays_are_named_and_rows_without_language_are_zeros() {
        let mut gaussians = two();
        gaussians.language.features[15..].fill(0.0);
        let mut stage = online(&CompressorConfig::default());
        let seen: Vec<f32> =
            (0..64 * GENERIC_SIZE).map(|i| ((i * 37 % 101) as f32).sin()).collect();
        stage.observe(&seen);
        let snapshot = MapSnapshot {
            map: "room".into(),
            revision: 1,
            through: None,
            gaussians: Arc::new(gaussians),
            online: stage.into(),
            trajectory: Arc::default(),
            keyframes: Arc::default(),
            evidence: Arc::default(),
            up: None,
        };
        let mut zip = zip::ZipArchive::new(Cursor::new(language_npz(&snapshot))).unwrap();
        let mut names: Vec<String> =
            zip.file_names().map(|name| name.unwrap().into_owned()).collect();
        names.sort();
        let expected = ["codes", "generic", "log_scale", "opacity", "rotation", "spread", "views"];
        assert_eq!(names, expected.map(|name| format!("{name}.npy")));
        let array = npyz::NpyFile::new(zip.by_name("generic.npy").unwrap()).unwrap();
        assert_eq!(array.shape(), [2, GENERIC_SIZE as u64]);
        let rows = array.into_vec::<f32>().unwrap();
        let length = |row: &[f32]| row.iter().map(|value| value * value).sum::<f32>();
        assert!((length(&rows[..GENERIC_SIZE]) - 1.0).abs() < 1e-4, "{rows:?}");
        assert_eq!(length(&rows[GENERIC_SIZE..]), 0.0);
    }
}
