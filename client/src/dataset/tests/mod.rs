//! Each layout on a tiny folder, and each with a broken twin.

mod against;
mod cameras;
mod captures;
mod formats;
pub(crate) mod mutations;
mod wild;

use crate::dataset::{
    ColorFormat, Dataset, DatasetError, Depth, Distortion, Folder, FrameRange, Intrinsics,
    Nerfstudio, R3d, Replica, RgbdFrame, ScanNet, SevenScenes, Tum, with_poses,
};
use image::{DynamicImage, GrayImage, ImageBuffer, Luma, RgbImage};
use nalgebra::Isometry3;
use std::fs;
use std::num::NonZeroUsize;
use std::path::Path;
use tempfile::TempDir;

const SIZE: (u32, u32) = (24, 16);
const IDENTITY: &str = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";
const NO_ROTATION: &str = "1 0 0 0 0 1.5 0 0 0 0 1 0 0 0 0 1";

fn put(folder: &Path, name: &str, contents: impl AsRef<[u8]>) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, contents).unwrap();
}

fn put_color(folder: &Path, name: &str, size: (u32, u32)) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    RgbImage::from_pixel(size.0, size.1, image::Rgb([90, 120, 60])).save(path).unwrap();
}

fn put_depth(folder: &Path, name: &str, units: impl Fn(u32, u32) -> u16) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, y| Luma([units(x, y)])).save(path).unwrap();
}

fn units(depth: &Depth) -> ImageBuffer<Luma<u16>, Vec<u16>> {
    match image::load_from_memory(&depth.bytes).unwrap() {
        DynamicImage::ImageLuma16(units) => units,
        other => panic!("expected 16-bit grey, found {:?}", other.color()),
    }
}

fn open(kind: &str, folder: &Path) -> Result<Box<dyn Dataset>, DatasetError> {
    Ok(match kind {
        "replica" => Box::new(Replica::open(folder)?),
        "tum" => Box::new(Tum::open(folder)?),
        "7scenes" => Box::new(SevenScenes::open(folder)?),
        "nerfstudio" => Box::new(Nerfstudio::open(folder)?),
        "folder" => Box::new(Folder::open(folder)?),
        "r3d" => Box::new(R3d::open(folder)?),
        "scannet" => Box::new(ScanNet::open(folder)?),
        other => panic!("no reader for {other}"),
    })
}

fn error(kind: &str, folder: &Path) -> String {
    open(kind, folder).err().expect("a broken folder is refused").to_string()
}

fn range(start: usize, end: Option<usize>, stride: usize) -> FrameRange {
    FrameRange { start, end, stride: NonZeroUsize::new(stride).unwrap(), ..FrameRange::default() }
}

/// Three frames in Replica layout that differ in color, depth, pose and mask.
fn replica() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let f = folder.path();
    let mut trajectory = String::new();
    for number in 0..3_u8 {
        fs::create_dir_all(f.join("results")).unwrap();
        let color = image::Rgb([90, 120, 40 * number]);
        let color = RgbImage::from_pixel(SIZE.0, SIZE.1, color);
        color.save(f.join(format!("results/frame{number:06}.jpg"))).unwrap();
        put_depth(f, &format!("results/depth{number:06}.png"), |x, y| {
            6000 + (x + y) as u16 + u16::from(number)
        });
        fs::create_dir_all(f.join("semantic")).unwrap();
        let mask = |x: u32, _| Luma([(x < 12 + u32::from(number)).into()]);
        let mask = GrayImage::from_fn(SIZE.0, SIZE.1, mask);
        mask.save(f.join(format!("semantic/{number:06}.png"))).unwrap();
        trajectory += &format!("1 0 0 {number} 0 1 0 2 0 0 1 3 0 0 0 1\n");
    }
    put(f, "traj.txt", trajectory);
    let camera = "{\"camera\":{\"w\":24,\"h\":16,\"fx\":17,\"fy\":18,\"cx\":11.5,\"cy\":7.5,\"scale\":6553.5}}";
    put(f, "cam_params.json", camera);
    let instance = |id: u16, class: &str| {
        format!(
            "{{\"id\":{id},\"name\":\"{class}_1\",\"class\":\"{class}\",\
             \"aabb_min\":[0,0,0],\"aabb_max\":[1,1,1]}}"
        )
    };
    put(f, "instances.json", format!("[{},{}]", instance(1, "chair"), instance(2, "wall")));
    folder
}

#[test]
fn a_replica_folder_is_read() {
    let folder = replica();
    let dataset = open("replica", folder.path()).unwrap();
    assert_eq!((dataset.len(), dataset.is_empty(), dataset.skipped().len()), (3, false, 0));
    let Intrinsics { width, height, fx, fy, cx, cy } = dataset.intrinsics();
    assert_eq!((width, height, fx, fy, cx, cy), (24, 16, 17.0, 18.0, 11.5, 7.5));
    assert_eq!(
        dataset.name(),
        folder.path().file_name().unwrap().to_str().unwrap().trim_start_matches('.')
    );
    assert_eq!(dataset.depth_unit_metres(), 1.0 / 6553.5);
    let frame = dataset.frame(2).unwrap();
    assert_eq!((frame.sequence, frame.timestamp_nanos), (2, 66_666_666));
    assert_eq!(frame.color.format, ColorFormat::Jpeg);
    assert_eq!(frame.world_from_camera, Some(Isometry3::translation(2.0, 2.0, 3.0)));
    assert_eq!(units(&frame.depth)[(5, 4)][0], 6011);
    let truth = dataset.truth().unwrap();
    let mask = truth.mask(2).unwrap();
    assert_eq!((mask.ids[13], mask.ids[14], mask.ids.len()), (1, 0, 24 * 16));
    assert_ne!(mask.ids, truth.mask(0).unwrap().ids);
    assert_eq!(truth.instances().len(), 2);
    assert_eq!(truth.classes(), ["chair"], "walls are part of the room");
}

#[test]
fn a_range_keeps_numbers_and_masks() {
    let folder = replica();
    let open = |range: FrameRange| range.of(open("replica", folder.path()).unwrap());
    let whole = open(FrameRange::default()).unwrap();
    let part = open(range(0, Some(9), 2)).unwrap();
    assert_eq!((0..part.len()).map(|i| part.sequence(i)).collect::<Vec<_>>(), [0, 2]);
    assert_eq!(part.frame(1).unwrap(), whole.frame(2).unwrap());
    let mask = |dataset: &dyn Dataset, i| dataset.truth().unwrap().mask(i).unwrap();
    assert_eq!(mask(&*part, 1), mask(&*whole, 2));
    let error = open(range(3, None, 1)).err().unwrap().to_string();
    assert_eq!(error, "no frames from 3 to the end: the data set has 3");
    assert!(open(range(2, Some(1), 1)).is_err());
}

#[test]
fn broken_replica_folders_name_file_and_line() {
    let break_and_open = |change: &dyn Fn(&Path)| {
        let folder = replica();
        change(folder.path());
        error("replica", folder.path())
    };
    let found = break_and_open(&|f| {
        (0..3).for_each(|n| put_color(f, &format!("results/frame00000{n}.jpg"), (9, 9)));
        (0..3).for_each(|n| put_color(f, &format!("results/depth00000{n}.png"), (9, 9)));
    });
    assert!(found.ends_with("expected 24x16 pixels as in cam_params.json, found 9x9"), "{found}");
    let found = break_and_open(&|f| put(f, "cam_params.json", "{\"camera\":{}}"));
    assert!(found.contains("cam_params.json: missing field"), "{found}");
    let found = break_and_open(&|f| put(f, "instances.json", "[{\"id\":1}]"));
    assert!(found.contains("instances.json: missing field"), "{found}");
    let found = break_and_open(&|f| {
        (0..3).for_each(|n| fs::remove_file(f.join(format!("results/depth00000{n}.png"))).unwrap());
    });
    assert!(
        found.contains("found none (") && found.contains("expected depth000000.png"),
        "{found}"
    );
}

#[test]
fn frames_without_a_valid_pose_are_there_and_say_why() {
    let folder = replica();
    for (lines, expected) in [
        (format!("{IDENTITY}\n{NO_ROTATION}\n{IDENTITY}\n"), "traj.txt:2: expected a rotation"),
        (format!("{IDENTITY}\n1 0 x\n{IDENTITY}\n"), "traj.txt:2: expected a number, found \"x\""),
        (format!("{IDENTITY}\n1 0 0\n{IDENTITY}\n"), "traj.txt:2: expected 16 numbers, found 3"),
    ] {
        put(folder.path(), "traj.txt", lines);
        let all = open("replica", folder.path()).unwrap();
        assert_eq!(
            (all.len(), all.no_pose(0), all.frame(1).unwrap().world_from_camera),
            (3, None, None)
        );
        let reason = all.no_pose(1).unwrap().to_owned();
        assert!(reason.contains(expected), "{reason}");
        let posed = with_poses(all).unwrap();
        assert_eq!((0..posed.len()).map(|i| posed.sequence(i)).collect::<Vec<_>>(), [0, 2]);
        assert_eq!((posed.skipped(), posed.no_pose(1)), (&[reason][..], None));
        let other = open("replica", folder.path()).unwrap();
        let mask = |dataset: &dyn Dataset, at| dataset.truth().unwrap().mask(at).unwrap();
        assert_eq!(mask(&*posed, 1), mask(&*other, 2));
    }
    put(folder.path(), "traj.txt", IDENTITY);
    let all = open("replica", folder.path()).unwrap();
    assert!(all.no_pose(2).unwrap().ends_with("expected a pose for frame 2, found only 1 lines"));
    fs::remove_file(folder.path().join("traj.txt")).unwrap();
    let none = open("replica", folder.path()).unwrap();
    assert_eq!(none.len(), 3);
    let error = with_poses(none).err().unwrap().to_string();
    assert!(error.contains("no frame has a pose") && error.contains("no such file"), "{error}");
}

#[test]
fn damaged_images_are_errors_when_read() {
    let folder = replica();
    let dataset = open("replica", folder.path()).unwrap();
    put(folder.path(), "results/frame000001.jpg", "no picture");
    let found = dataset.frame(1).unwrap_err().to_string();
    assert!(found.ends_with("frame000001.jpg: expected a JPEG or PNG picture"), "{found}");
    GrayImage::new(3, 3).save(folder.path().join("semantic/000001.png")).unwrap();
    let found = dataset.truth().unwrap().mask(1).unwrap_err().to_string();
    assert!(found.contains("expected 24x16 grey pixels of 8 or 16 bits, found 3x3"), "{found}");
    assert!(dataset.frame(0).is_ok() && dataset.truth().unwrap().mask(0).is_ok());
}

#[test]
fn masks_of_sixteen_bits_are_read() {
    let folder = replica();
    put_depth(folder.path(), "semantic/000000.png", |x, y| (x * 300 + y) as u16);
    let dataset = open("replica", folder.path()).unwrap();
    let mask = dataset.truth().unwrap().mask(0).unwrap();
    assert_eq!((mask.ids[1], mask.ids[24]), (300, 1));
}

#[test]
fn passes_go_there_and_back_under_new_numbers() {
    let folder = replica();
    let open = |range: FrameRange| range.of(open("replica", folder.path()).unwrap());
    let range = FrameRange { passes: NonZeroUsize::new(3).unwrap(), ..FrameRange::default() };
    let walk = open(range).unwrap();
    let once = open(FrameRange::default()).unwrap();
    let shown = [0, 1, 2, 1, 0, 1, 2];
    assert_eq!(walk.len(), shown.len());
    for (index, of) in shown.into_iter().enumerate() {
        let (found, expected) = (walk.frame(index).unwrap(), once.frame(of).unwrap());
        assert_eq!((found.sequence, walk.sequence(index)), (index as u64, index as u64));
        assert_eq!(found.timestamp_nanos, index as u64 * 1_000_000_000 / 30);
        assert_eq!(
            (found.color, found.world_from_camera),
            (expected.color, expected.world_from_camera)
        );
        let mask = |dataset: &dyn Dataset, at| dataset.truth().unwrap().mask(at).unwrap();
        assert_eq!(mask(&*walk, index), mask(&*once, of));
    }
}

/// Frames 0, 2 and 7 in 7-Scenes layout; only frame 2 has holes of both kinds.
fn seven_scenes() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let f = folder.path();
    for number in [0, 2, 7] {
        put_color(f, &format!("frame-{number:06}.color.png"), SIZE);
        put_depth(f, &format!("frame-{number:06}.depth.png"), |x, y| match (number, x, y) {
            (2, 0, 0) => 65535,
            (2, 1, 0) => 0,
            _ => 1500 + x as u16,
        });
        put(f, &format!("frame-{number:06}.pose.txt"), IDENTITY.replace(" 0 0 0 1", "\n0 0 0 1"));
    }
    put(f, "camera-intrinsics.txt", "17 0 11\n0 18 7\n0 0 1\n");
    folder
}

#[test]
fn seven_scenes_keeps_numbers_and_fills_holes_with_0() {
    let folder = seven_scenes();
    let dataset = open("7scenes", folder.path()).unwrap();
    let numbers: Vec<u64> = (0..dataset.len()).map(|i| dataset.sequence(i)).collect();
    assert_eq!((numbers, dataset.depth_unit_metres()), (vec![0, 2, 7], 0.001));
    let camera = dataset.intrinsics();
    assert_eq!((camera.width, camera.height, camera.fx, camera.cy), (24, 16, 17.0, 7.0));
    let mended = units(&dataset.frame(1).unwrap().depth);
    assert_eq!((mended[(0, 0)][0], mended[(1, 0)][0], mended[(2, 0)][0]), (0, 0, 1502));
    let frame = dataset.frame(2).unwrap();
    let on_disk = fs::read(folder.path().join("frame-000007.depth.png")).unwrap();
    assert_eq!((frame.depth.bytes, frame.sequence), (on_disk, 7));
    assert_eq!((frame.color.format, frame.timestamp_nanos), (ColorFormat::Png, 233_333_333));
    assert!(dataset.truth().is_none());
    assert_eq!([camera.fx, camera.fy, camera.cx, camera.cy], [17.0, 18.0, 11.0, 7.0]);
    assert!(dataset.notes().is_empty());
}

#[test]
fn broken_seven_scenes_folders_are_refused() {
    let folder = seven_scenes();
    put(folder.path(), "frame-000002.pose.txt", NO_ROTATION);
    put(folder.path(), "frame-000007.pose.txt", IDENTITY.replace('1', "NaN"));
    let dataset = with_poses(open("7scenes", folder.path()).unwrap()).unwrap();
    assert_eq!((dataset.len(), dataset.skipped().len()), (1, 2));
    assert!(dataset.skipped()[1].contains("frame-000007.pose.txt: expected finite numbers"));
    put(folder.path(), "frame-000002.pose.txt", "1 2 3");
    let dataset = open("7scenes", folder.path()).unwrap();
    assert!(dataset.no_pose(1).unwrap().contains("frame-000002.pose.txt: expected 16 numbers"));
    fs::remove_file(folder.path().join("frame-000000.depth.png")).unwrap();
    let dataset = open("7scenes", folder.path()).unwrap();
    assert_eq!((dataset.len(), dataset.skipped().len()), (2, 1));
    assert!(dataset.skipped()[0].contains("expected frame-000000.depth.png beside it"));
    put(folder.path(), "camera-intrinsics.txt", "500 0 11\n");
    assert!(error("7scenes", folder.path()).ends_with("expected 9 numbers, found 3"));
    let empty = tempfile::tempdir().unwrap();
    assert!(error("7scenes", empty.path()).contains("name one sequence"));
}

/// Four pictures; the third has no depth close by.
fn tum(camera: &str) -> (TempDir, std::path::PathBuf) {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join(camera);
    let stamps = ["100.000000", "100.033000", "100.066000", "100.100000"];
    let mut list = "# timestamp filename\n".to_owned();
    for stamp in stamps {
        put_color(&folder, &format!("rgb/{stamp}.png"), SIZE);
        list += &format!("{stamp} rgb/{stamp}.png\n");
    }
    put(&folder, "rgb.txt", &list);
    let mut list = String::new();
    for (i, stamp) in ["100.010000", "100.026000", "100.119000"].iter().enumerate() {
        put_depth(&folder, &format!("depth/{stamp}.png"), |_, _| 5000 + i as u16);
        list += &format!("{stamp} depth/{stamp}.png\n");
    }
    put(&folder, "depth.txt", &list);
    let poses = "99.95 1 0 0 0 0 0 1\n100.03 2 0 0 0 0 0 1\n100.17 3 0 0 0 0 1 0\n";
    put(&folder, "groundtruth.txt", poses);
    put(&folder, "camera.txt", "17 18 11.5 7.5\n");
    (parent, folder)
}

#[test]
fn tum_pairs_the_closest() {
    let (_keep, folder) = tum("rgbd_dataset_freiburg2_desk");
    let dataset = open("tum", &folder).unwrap();
    let frames: Vec<RgbdFrame> = (0..dataset.len()).map(|i| dataset.frame(i).unwrap()).collect();
    let found: Vec<_> = frames
        .iter()
        .map(|frame| {
            let x = frame.world_from_camera.unwrap().translation.x;
            (frame.sequence, frame.timestamp_nanos, units(&frame.depth)[(0, 0)][0], x)
        })
        .collect();
    let expected = [
        (0, 100_000_000_000, 5000, 2.0),
        (1, 100_033_000_000, 5001, 2.0),
        (3, 100_100_000_000, 5002, 2.0),
    ];
    assert_eq!(found, expected);
    assert_eq!((dataset.intrinsics().fx, dataset.skipped().len()), (17.0, 1));
    assert!(dataset.skipped()[0].contains("100.066000.png: expected depth at most 0.02 s away"));
    let turned = "100.1 3 0 0 0 0 1 0\n";
    put(&folder, "groundtruth.txt", turned);
    let dataset = with_poses(open("tum", &folder).unwrap()).unwrap();
    assert_eq!((dataset.len(), dataset.skipped().len()), (2, 2));
    let angle = dataset.frame(0).unwrap().world_from_camera.unwrap().rotation.angle();
    assert!((angle - std::f64::consts::PI).abs() < 1e-9);
    fs::remove_file(folder.join("groundtruth.txt")).unwrap();
    assert_eq!(open("tum", &folder).unwrap().frame(0).unwrap().world_from_camera, None);
}

#[test]
fn broken_tum_folders_name_file_and_line() {
    let broken = |file: &str, text: &str| {
        let (_keep, folder) = tum("office");
        put(&folder, file, text);
        error("tum", &folder)
    };
    let found = broken("rgb.txt", "#\n1 rgb/a.png\nsoon rgb/a.png\n");
    assert!(found.ends_with("rgb.txt:3: expected seconds, found \"soon\""), "{found}");
    let found = broken("rgb.txt", "100.0\n");
    assert!(found.ends_with("rgb.txt:1: expected a timestamp and a file, found no file"));
    let found = broken("depth.txt", "300.0 depth/100.010000.png\n");
    assert!(found.contains("at most 0.02 s"), "{found}");
    let found = broken("camera.txt", "481.2 480\n");
    assert!(found.ends_with("camera.txt:1: expected 4 numbers, found 2"), "{found}");
    let (_keep, folder) = tum("office");
    for stamp in ["100.010000", "100.026000", "100.119000"] {
        put_color(&folder, &format!("depth/{stamp}.png"), (9, 9));
    }
    assert!(error("tum", &folder).ends_with("expected 24x16 pixels, found 9x9"));
    for (poses, expected) in [
        ("100.0 1 2 3\n", "groundtruth.txt:1: expected 7 numbers, found 3"),
        ("100.0 1 0 0 0 0 0 0.5\n", "groundtruth.txt:1: expected a quaternion of length 1"),
        ("900.0 1 0 0 0 0 0 1\n", "expected a pose at most 0.08 s away, found none"),
    ] {
        let (_keep, folder) = tum("office");
        put(&folder, "groundtruth.txt", poses);
        let dataset = open("tum", &folder).unwrap();
        assert!(dataset.no_pose(0).unwrap().contains(expected), "{:?}", dataset.no_pose(0));
        assert!(with_poses(dataset).is_err());
    }
}
