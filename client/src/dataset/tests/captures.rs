//! Files of Record3D and ScanNet, written here after their published layouts, whole and damaged.

use super::formats::{inspected, opengl_rows, pose_of};
use super::*;
use crate::dataset::{DepthCamera, R3d, ScanNet};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use nalgebra::Point3;
use std::io::{Cursor, Write as _};
use std::path::PathBuf;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

const SMALL: (u32, u32) = (6, 4);

fn jpeg() -> Vec<u8> {
    let mut bytes = Vec::new();
    let picture = RgbImage::from_pixel(SIZE.0, SIZE.1, image::Rgb([90, 120, 60]));
    picture.write_to(&mut Cursor::new(&mut bytes), image::ImageFormat::Jpeg).unwrap();
    bytes
}

fn deflated(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn lzfse(bytes: &[u8]) -> Vec<u8> {
    let mut compressed = Vec::new();
    lzfse_rust::encode_bytes(bytes, &mut compressed).unwrap();
    compressed
}

/// How depth and confidence are compressed.
type Compress = fn(&[u8]) -> Vec<u8>;

/// A recording of Record3D with frames 0, 1, 2 and 10; frame 5 has no depth.
fn record3d(folder: &Path, compress: Compress, change: impl Fn(&mut serde_json::Value)) -> PathBuf {
    let path = folder.join("kitchen.r3d");
    let mut zip = ZipWriter::new(fs::File::create(&path).unwrap());
    let options = SimpleFileOptions::default();
    let deflate = options.compression_method(zip::CompressionMethod::Deflated);
    let mut poses = Vec::new();
    for number in 0..11 {
        let rows = opengl_rows(&pose_of(number));
        let flat: [f64; 16] = rows.concat().try_into().unwrap();
        let rotation = nalgebra::Matrix3::from_fn(|row, column| flat[4 * row + column]);
        let rotation = nalgebra::UnitQuaternion::from_matrix(&rotation);
        poses.push(serde_json::json!([
            rotation.i, rotation.j, rotation.k, rotation.w, flat[3], flat[7], flat[11]
        ]));
    }
    let times: Vec<f64> = (0..11).map(|number| 50.0 + f64::from(number) / 60.0).collect();
    let mut metadata = serde_json::json!({
        "w": SIZE.0, "h": SIZE.1, "dw": SMALL.0, "dh": SMALL.1, "fps": 60,
        "K": [17.0, 0, 0, 0, 18.0, 0, 11.5, 7.5, 1],
        "poses": poses, "frameTimestamps": times,
    });
    change(&mut metadata);
    zip.start_file("metadata", deflate).unwrap();
    zip.write_all(metadata.to_string().as_bytes()).unwrap();
    for number in [0, 1, 2, 5, 10] {
        zip.start_file(format!("rgbd/{number}.jpg"), options).unwrap();
        zip.write_all(&jpeg()).unwrap();
        if number == 5 {
            continue;
        }
        let metres = |at: u32| if at == 3 { f32::NAN } else { 1.0 + at as f32 / 100.0 };
        let depth: Vec<u8> =
            (0..SMALL.0 * SMALL.1).flat_map(|at| metres(at).to_le_bytes()).collect();
        zip.start_file(format!("rgbd/{number}.depth"), options).unwrap();
        zip.write_all(&compress(&depth)).unwrap();
        let sure: Vec<u8> = (0..SMALL.0 * SMALL.1).map(|at| (at % 3) as u8).collect();
        zip.start_file(format!("rgbd/{number}.conf"), options).unwrap();
        zip.write_all(&compress(&sure)).unwrap();
    }
    zip.finish().unwrap();
    path
}

#[test]
fn record3d_is_read_however_depth_is_compressed() {
    let folder = tempfile::tempdir().unwrap();
    let ways: [(&str, Compress); 3] =
        [("lzfse", lzfse), ("zlib", deflated), ("no", <[u8]>::to_vec)];
    for (name, compress) in ways {
        let path = record3d(folder.path(), compress, |_| ());
        let dataset = R3d::open(&path).unwrap();
        let numbers: Vec<u64> = (0..dataset.len()).map(|at| dataset.sequence(at)).collect();
        assert_eq!((numbers, dataset.name()), (vec![0, 1, 2, 10], "kitchen"), "{name}");
        assert_eq!(dataset.skipped().len(), 1);
        assert!(dataset.skipped()[0].contains("frame 5: expected .jpg and .depth"));
        let frame = dataset.frame(3).unwrap();
        assert_eq!(frame.timestamp_nanos, 50_166_666_666);
        let depth = units(&frame.depth).into_raw();
        // Low confidence, 1.01 m of medium confidence, and no number.
        assert_eq!((depth[0], depth[1], depth[2], depth[3]), (0, 4040, 4080, 0), "{name}");
        let (found, wanted) = (frame.world_from_camera.unwrap(), pose_of(10));
        let ahead = Point3::new(0.3, -0.2, 2.0);
        assert!((found * ahead - wanted * ahead).norm() < 1e-6, "{name}");
        // Negative control: read with other axes, the point is elsewhere.
        assert!((found * Point3::new(0.3, 0.2, -2.0) - wanted * ahead).norm() > 1.0);
    }
    let path = record3d(folder.path(), lzfse, |_| ());
    let cameras = R3d::open(&path).unwrap().cameras();
    assert_eq!(cameras.depth, Some(DepthCamera::SameLens { width: 6, height: 4 }));
    let Intrinsics { fx, fy, cx, cy, .. } = cameras.color.intrinsics;
    assert_eq!(([fx, fy, cx, cy], cameras.up), ([17.0, 18.0, 11.5, 7.5], Some([0.0, 1.0, 0.0])));
    let found = inspected("r3d", &path);
    assert_eq!((found.readable, found.with_pose, &*found.problems), (4, 4, &[][..]));
}

#[test]
fn record3d_may_say_less_or_more() {
    let folder = tempfile::tempdir().unwrap();
    let changed = |change: &dyn Fn(&mut serde_json::Value)| {
        R3d::open(&record3d(folder.path(), lzfse, change))
    };
    // Each frame its own lens; the size of depth as it follows; no times, a rate.
    let dataset = changed(&|metadata| {
        let own = |number: u32| serde_json::json!([17.0 + f64::from(number), 18.0, 11.5, 7.5]);
        metadata["perFrameIntrinsicCoeffs"] = (0..11).map(own).collect();
        for key in ["K", "dw", "dh", "frameTimestamps"] {
            metadata.as_object_mut().unwrap().remove(key);
        }
    })
    .unwrap();
    assert_eq!(dataset.frame(0).unwrap().extras.intrinsics, None);
    assert_eq!(dataset.frame(2).unwrap().extras.intrinsics.unwrap().fx, 19.0);
    assert_eq!(dataset.moment(3).unwrap().timestamp_nanos, 166_666_666);
    assert_eq!(dataset.cameras().depth_size(), (6, 4));
    // Pictures of another size than the camera is said for.
    let dataset = changed(&|metadata| {
        (metadata["w"], metadata["h"]) = (48.into(), 32.into());
    })
    .unwrap();
    assert_eq!((dataset.intrinsics().width, dataset.intrinsics().fx), (24, 8.5));
    // Poses that are missing or none.
    let dataset = changed(&|metadata| {
        metadata["poses"] = serde_json::json!([[0, 0, 0, 1, 0, 0, 0], [0, 0, 0, 9, 0, 0, 0], [1]]);
    })
    .unwrap();
    let reasons: Vec<_> = (0..4).map(|at| dataset.no_pose(at).unwrap_or("-")).collect();
    for (reason, expected) in
        reasons.iter().zip(["-", "quaternion of length 1", "7 numbers, found 1", "found none"])
    {
        assert!(reason.contains(expected), "{reason}");
    }
    for (key, value, expected) in [
        ("K", serde_json::json!([1, 2]), "metadata: expected K, 3x3"),
        ("K", serde_json::json!([0, 0, 0, 0, 1, 0, 1, 1, 1]), "expected fx fy cx cy, found 0 1"),
        ("dw", serde_json::json!(0), "dw, dh: expected pixels, found 0x4"),
        ("w", serde_json::json!("wide"), "metadata: invalid type"),
    ] {
        let error = changed(&|metadata| metadata[key] = value.clone()).err().unwrap().to_string();
        assert!(error.contains("kitchen.r3d") && error.contains(expected), "{key}: {error}");
    }
    let dataset = changed(&|metadata| metadata["dw"] = 7.into()).unwrap();
    let error = dataset.frame(0).unwrap_err().to_string();
    assert!(error.contains("rgbd/0.depth: expected 112 bytes, found 96"), "{error}");
    put(folder.path(), "kitchen.r3d", "no zip");
    let error = R3d::open(&folder.path().join("kitchen.r3d")).err().unwrap().to_string();
    assert!(error.contains("expected a zip, as .r3d files are"), "{error}");
}

/// What differs between `.sens` files.
struct Sens {
    color: i32,
    depth: i32,
    /// Pose of the depth camera in the color camera's coordinates.
    placed: Isometry3<f64>,
    frames: u64,
}

impl Default for Sens {
    fn default() -> Self {
        let placed = Isometry3::translation(0.05, 0.0, 0.0);
        Self { color: 2, depth: 1, placed, frames: 3 }
    }
}

fn matrix(pose: &Isometry3<f64>) -> Vec<u8> {
    let rows = pose.to_homogeneous().transpose();
    rows.iter().flat_map(|number| (*number as f32).to_le_bytes()).collect()
}

fn lens([fx, fy, cx, cy]: [f32; 4]) -> Vec<u8> {
    let rows = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    rows.iter().flat_map(|number: &f32| number.to_le_bytes()).collect()
}

/// A file as ScanNet's SensReader writes it; frame 1 has no pose.
fn sens(folder: &Path, kind: &Sens) -> PathBuf {
    let path = folder.join("scene0000_00.sens");
    let mut file = Vec::new();
    file.extend(4_u32.to_le_bytes());
    file.extend(15_u64.to_le_bytes());
    file.extend(b"StructureSensor");
    file.extend(lens([17.0, 18.0, 11.5, 7.5]));
    file.extend(matrix(&Isometry3::identity()));
    file.extend(lens([5.0, 5.5, 2.5, 1.5]));
    file.extend(matrix(&kind.placed));
    file.extend([kind.color.to_le_bytes(), kind.depth.to_le_bytes()].concat());
    for side in [SIZE.0, SIZE.1, SMALL.0, SMALL.1] {
        file.extend(side.to_le_bytes());
    }
    file.extend(1000_f32.to_le_bytes());
    file.extend(kind.frames.to_le_bytes());
    for number in 0..3_u64 {
        let lost = f32::NEG_INFINITY.to_le_bytes().repeat(16);
        file.extend(if number == 1 { lost } else { matrix(&pose_of(number as usize)) });
        file.extend((1_000_000 + number * 33_333).to_le_bytes());
        file.extend((1_000_000 + number * 33_333 + 8000).to_le_bytes());
        let color = match kind.color {
            0 => [90, 120, 60].repeat((SIZE.0 * SIZE.1) as usize),
            _ => jpeg(),
        };
        let units = (0..SMALL.0 * SMALL.1).flat_map(|at| (500 + at as u16).to_le_bytes());
        let units: Vec<u8> = units.collect();
        let depth = if kind.depth == 1 { deflated(&units) } else { units };
        file.extend((color.len() as u64).to_le_bytes());
        file.extend((depth.len() as u64).to_le_bytes());
        file.extend([color, depth].concat());
    }
    file.extend(0_u64.to_le_bytes());
    fs::write(&path, file).unwrap();
    path
}

#[test]
fn scannet_is_read_with_its_two_cameras() {
    let folder = tempfile::tempdir().unwrap();
    for (color, depth, format) in [(2, 1, ColorFormat::Jpeg), (0, 0, ColorFormat::Rgb8)] {
        let path = sens(folder.path(), &Sens { color, depth, ..Sens::default() });
        let dataset = ScanNet::open(&path).unwrap();
        assert_eq!((dataset.len(), dataset.name()), (3, "scene0000_00"));
        assert_eq!((dataset.depth_unit_metres(), dataset.notes().len()), (0.001, 0));
        let frame = dataset.frame(2).unwrap();
        assert_eq!((frame.sequence, frame.color.format), (2, format));
        assert_eq!(frame.timestamp_nanos, 1_066_666_000);
        assert_eq!(frame.extras.depth_timestamp_nanos, Some(1_074_666_000));
        let depth = units(&frame.depth);
        assert_eq!((depth.dimensions(), depth[(2, 3)][0]), (SMALL, 520));
        let found = frame.world_from_camera.unwrap();
        assert!((found.inverse() * pose_of(2)).translation.vector.norm() < 1e-5);
        assert!(dataset.no_pose(1).unwrap().contains("frame 1: expected finite numbers"));
        let found = inspected("scannet", &path);
        assert_eq!((found.readable, found.with_pose, &*found.problems), (3, 2, &[][..]));
    }
    let open = |kind: &Sens| ScanNet::open(&sens(folder.path(), kind));
    let Some(DepthCamera::Own { camera, color_from_depth }) =
        open(&Sens::default()).unwrap().cameras().depth
    else {
        panic!()
    };
    assert_eq!((camera.intrinsics.width, camera.intrinsics.fy), (6, 5.5));
    assert!((color_from_depth.translation.x - 0.05).abs() < 1e-6);
}

#[test]
fn damaged_scannet_files_say_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let open = |kind: &Sens| ScanNet::open(&sens(folder.path(), kind));
    let error = open(&Sens { depth: 2, ..Sens::default() }).err().unwrap().to_string();
    assert!(error.contains("expected raw_ushort or zlib_ushort, found kind 2"), "{error}");
    let error = open(&Sens { color: -1, ..Sens::default() }).err().unwrap().to_string();
    assert!(error.contains("expected raw, PNG or JPEG, found kind -1"), "{error}");
    // More frames are said than there are, and a file that was cut.
    let dataset = open(&Sens { frames: u64::MAX, ..Sens::default() }).unwrap();
    assert_eq!(dataset.len(), 3);
    assert!(dataset.skipped()[0].contains("frame 3: the file ends"), "{:?}", dataset.skipped());
    let path = sens(folder.path(), &Sens::default());
    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..whole.len() - 20]).unwrap();
    let dataset = ScanNet::open(&path).unwrap();
    assert_eq!((dataset.len(), dataset.skipped().len()), (2, 1));
    assert!(dataset.skipped()[0].contains("frame 2: the file ends within its pictures"));
    fs::write(&path, &whole[..300]).unwrap();
    let error = ScanNet::open(&path).err().unwrap().to_string();
    assert!(error.contains("scene0000_00.sens: the file ends"), "{error}");
    fs::write(&path, [9, 0, 0, 0]).unwrap();
    let error = ScanNet::open(&path).err().unwrap().to_string();
    assert!(error.contains("expected a .sens file of version 4, found 9"), "{error}");
    // A frame whose depth is damaged costs that frame only.
    let mut broken = whole.clone();
    let last = broken.len() - 16;
    broken[last..last + 8].fill(0xff);
    fs::write(&path, broken).unwrap();
    let dataset = ScanNet::open(&path).unwrap();
    let error = dataset.frame(2).unwrap_err().to_string();
    assert!(error.contains("frame 2: depth: "), "{error}");
    assert!(dataset.frame(1).is_ok());
    // Extrinsics that are no pose are told of.
    let mirrored = {
        let mut file = whole;
        let at = 4 + 8 + 15 + 3 * 64;
        file[at..at + 4].copy_from_slice(&(-1.0_f32).to_le_bytes());
        file
    };
    fs::write(&path, mirrored).unwrap();
    let dataset = ScanNet::open(&path).unwrap();
    assert!(
        dataset.notes()[0].contains("extrinsics of depth are not used"),
        "{:?}",
        dataset.notes()
    );
}

/// A folder with one file of a kind, to be damaged.
pub(super) fn alone(kind: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    match kind {
        "r3d" => record3d(folder.path(), lzfse, |_| ()),
        _ => sens(folder.path(), &Sens::default()),
    };
    folder
}
