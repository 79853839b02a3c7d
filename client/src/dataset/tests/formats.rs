//! The layouts of nerfstudio and of described folders, in files written here, and what an inspection says.

use super::*;
use crate::dataset::{DepthCamera, FrameRate, Inspection, inspect};
use nalgebra::{Point3, UnitQuaternion, Vector3};

/// Places of three frames: the camera goes right and turns right.
pub(super) fn pose_of(number: usize) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.1 * number as f64);
    Isometry3::from_parts(Vector3::new(0.1 * number as f64, 0.5, -1.0).into(), turn)
}

/// Rows of a matrix whose camera axes are x right, y up, z back: the second and third column are negated.
pub(super) fn opengl_rows(pose: &Isometry3<f64>) -> Vec<Vec<f64>> {
    let matrix = pose.to_homogeneous();
    let sign = |column: usize| if column == 1 || column == 2 { -1.0 } else { 1.0 };
    (0..4).map(|row| (0..4).map(|column| sign(column) * matrix[(row, column)]).collect()).collect()
}

/// A folder as an app for phones writes it: depth of half the size, frames in no order.
pub(super) fn nerfstudio(change: impl Fn(&mut serde_json::Value)) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let f = folder.path();
    let mut frames = Vec::new();
    for number in [2, 10, 1] {
        put_color(f, &format!("images/frame_{number}.png"), SIZE);
        let small =
            ImageBuffer::from_fn(SIZE.0 / 2, SIZE.1 / 2, |x, y| Luma([(1000 + 10 * x + y) as u16]));
        fs::create_dir_all(f.join("depth")).unwrap();
        small.save(f.join(format!("depth/frame_{number}.png"))).unwrap();
        frames.push(serde_json::json!({
            "file_path": format!("images/frame_{number}.png"),
            "depth_file_path": format!("depth/frame_{number}.png"),
            "transform_matrix": opengl_rows(&pose_of(number)),
        }));
    }
    let mut list = serde_json::json!({
        "camera_model": "OPENCV", "w": 24, "h": 16,
        "fl_x": 17.0, "fl_y": 18.0, "cx": 12.0, "cy": 8.0,
        "k1": 0.0, "p1": 0.0, "frames": frames,
    });
    change(&mut list);
    put(f, "transforms.json", list.to_string());
    folder
}

#[test]
fn nerfstudio_is_read_with_its_axes_its_order_and_its_small_depth() {
    let folder = nerfstudio(|_| ());
    let dataset = Nerfstudio::open(folder.path()).unwrap();
    let Intrinsics { width, height, fx, fy, cx, cy } = dataset.intrinsics();
    assert_eq!((width, height, fx, fy, cx, cy), (24, 16, 17.0, 18.0, 11.5, 7.5));
    assert_eq!((dataset.len(), dataset.depth_unit_metres(), dataset.notes().len()), (3, 0.001, 0));
    let small = DepthCamera::SameLens { width: 12, height: 8 };
    assert_eq!(dataset.cameras().depth, Some(small));
    for (at, number) in [1, 2, 10].into_iter().enumerate() {
        let frame = dataset.frame(at).unwrap();
        let found = frame.world_from_camera.unwrap();
        let (ahead, wanted) = (Point3::new(0.3, -0.2, 2.0), pose_of(number));
        assert!((found * ahead - wanted * ahead).norm() < 1e-9, "{number}");
        // Negative control: read with other axes, the point is elsewhere.
        let flipped = Point3::new(0.3, 0.2, -2.0);
        assert!((found * flipped - wanted * ahead).norm() > 1.0);
        let depth = units(&frame.depth);
        assert_eq!((depth.dimensions(), depth[(5, 3)][0]), ((12, 8), 1053), "as it is stored");
    }
}

#[test]
fn nerfstudio_says_what_it_does_not_use_and_what_is_missing() {
    let error = |change: &dyn Fn(&mut serde_json::Value)| {
        let folder = nerfstudio(change);
        Nerfstudio::open(folder.path()).unwrap_err().to_string()
    };
    let found = error(&|list| list["camera_model"] = "EQUIRECTANGULAR".into());
    assert!(found.contains("expected one of OPENCV") && found.contains("EQUIRECT"), "{found}");
    let found = error(&|list| drop(list.as_object_mut().unwrap().remove("cx")));
    assert!(found.ends_with("transforms.json: missing field cx"), "{found}");
    let no_depth = |frame: &mut serde_json::Value| {
        frame.as_object_mut().unwrap().remove("depth_file_path");
    };
    let found = error(&|list| list["frames"].as_array_mut().unwrap().iter_mut().for_each(no_depth));
    assert!(found.contains("expected frames with depth_file_path"), "{found}");
    let folder = nerfstudio(|list| {
        no_depth(&mut list["frames"][0]);
        list["frames"][1]["transform_matrix"] = serde_json::json!([[1.0, 0.0]]);
        list["frames"][2]["file_path"] = "images/frame_1".into();
    });
    let dataset = Nerfstudio::open(folder.path()).unwrap();
    assert_eq!((dataset.len(), dataset.skipped().len()), (2, 1));
    assert!(dataset.no_pose(1).unwrap().contains("expected a transform_matrix of 4x4, found 2"));
    assert!(dataset.frame(0).is_ok(), "a name without its extension");
}

pub(super) const DESCRIPTION: &str = r#"
[color]
files = "color/*.PNG"
[depth]
files = "depth/*.png"
unit_metres = 0.002
[camera]
fx = 17.0
fy = 18.0
cx = 11.5
cy = 7.5
"#;

fn matrix(pose: &Isometry3<f64>) -> String {
    let matrix = pose.to_homogeneous();
    let row = |row: usize| {
        (0..4).map(|column| matrix[(row, column)].to_string()).collect::<Vec<_>>().join(" ")
    };
    (0..4).map(row).collect::<Vec<_>>().join("\n")
}

/// Numbered pictures, with a file of a pose each; number 7 has no depth.
pub(super) fn described(more: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let f = folder.path();
    for number in [0, 2, 7, 10] {
        put_color(f, &format!("color/{number}.png"), SIZE);
        put(f, &format!("pose/{number}.txt"), matrix(&pose_of(number)));
        if number != 7 {
            put_depth(f, &format!("depth/{number}.png"), |x, _| 500 + x as u16);
        }
    }
    put(f, "recording.toml", format!("{more}\n{DESCRIPTION}"));
    folder
}

pub(super) fn with_table(table: &str) -> TempDir {
    let folder = described("");
    put(folder.path(), "recording.toml", format!("{DESCRIPTION}\n{table}"));
    folder
}

#[test]
fn a_described_folder_is_read() {
    let folder = described("frames_per_second = 10.0");
    let dataset = Folder::open(folder.path()).unwrap();
    let numbers: Vec<u64> = (0..dataset.len()).map(|at| dataset.sequence(at)).collect();
    assert_eq!((numbers, dataset.skipped().len()), (vec![0, 2, 10], 1));
    assert!(dataset.skipped()[0].contains("7.png: expected depth with the same number"));
    let frame = dataset.frame(2).unwrap();
    assert_eq!((frame.timestamp_nanos, frame.world_from_camera), (1_000_000_000, None));
    assert_eq!((dataset.depth_unit_metres(), dataset.intrinsics().cx), (0.002, 11.5));
    assert!(dataset.no_pose(0).unwrap().ends_with("it has no [poses]"));
}

#[test]
fn poses_of_a_described_folder_come_from_files_lines_or_times() {
    let close = |folder: &TempDir, at: usize, wanted: Isometry3<f64>| {
        let dataset = Folder::open(folder.path()).unwrap();
        let found = dataset.moment(at).unwrap().world_from_camera.unwrap();
        (found.inverse() * wanted).translation.vector.norm()
            + (found.rotation.angle_to(&wanted.rotation))
            < 1e-9
    };
    let files = with_table("[poses]\nfiles = \"pose/*.txt\"");
    assert!(close(&files, 2, pose_of(10)) && !close(&files, 2, pose_of(7)));
    let inverse = with_table("[poses]\nfiles = \"pose/*.txt\"\ninverse = true");
    assert!(close(&inverse, 2, pose_of(10).inverse()) && !close(&inverse, 2, pose_of(10)));
    let opengl = with_table("[poses]\nfiles = \"pose/*.txt\"\naxes = \"opengl\"");
    let half = Isometry3::rotation(Vector3::new(std::f64::consts::PI, 0.0, 0.0));
    assert!(close(&opengl, 1, pose_of(2) * half) && !close(&opengl, 1, pose_of(2)));
    let lines = with_table("[poses]\nfile = \"poses.txt\"");
    let each = [0, 2, 7, 10].map(|number| matrix(&pose_of(number)).replace('\n', " "));
    put(lines.path(), "poses.txt", each.join("\n"));
    assert!(close(&lines, 2, pose_of(10)) && !close(&lines, 2, pose_of(7)));
    let timed = with_table("[poses]\ntum = \"poses.txt\"");
    put(timed.path(), "poses.txt", "0 9 0 0 0 0 0 1\n0.3334 4 0 0 0 0 0 1\n");
    assert!(close(&timed, 2, Isometry3::translation(4.0, 0.0, 0.0)));
}

#[test]
fn names_may_be_times() {
    for (names, stamps, depth) in [
        ("seconds", ["100.000000", "100.033000"], "100.010000"),
        ("nanoseconds", ["100000000000", "100033000000"], "100010000000"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let f = folder.path();
        stamps.iter().for_each(|stamp| put_color(f, &format!("color/{stamp}.png"), SIZE));
        put_depth(f, &format!("depth/{depth}.png"), |_, _| 700);
        put(f, "recording.toml", format!("names = \"{names}\"\n{DESCRIPTION}"));
        let dataset = Folder::open(f).unwrap();
        assert_eq!((dataset.len(), dataset.skipped().len(), dataset.sequence(0)), (1, 1, 0));
        assert_eq!(dataset.moment(0).unwrap().timestamp_nanos, 100_000_000_000);
    }
}

#[test]
fn wrong_descriptions_say_what_is_wrong() {
    for (change, expected) in [
        (("fx = 17.0", "fx = \"wide\""), "invalid type"),
        (("fx = 17.0", ""), "missing field `fx`"),
        (("[camera]", "[camara]"), "unknown field `camara`"),
        (("unit_metres = 0.002", "unit_metres = 0.0"), "depth.unit_metres: expected more than 0"),
        (("color/*.PNG", "color/a.png"), "expected one * in the name"),
        (("color/*.PNG", "colour/*.png"), "cannot read"),
        (("depth/*.png", "depth/x*.png"), "expected color and depth that belong together"),
        (("[camera]", "[poses]\n[camera]"), "poses: expected one of files, file and tum"),
    ] {
        let folder = described("");
        let text = DESCRIPTION.replace(change.0, change.1);
        put(folder.path(), "recording.toml", text);
        let error = Folder::open(folder.path()).unwrap_err().to_string();
        assert!(error.contains(expected), "{change:?}: {error}");
    }
    let empty = tempfile::tempdir().unwrap();
    assert!(Folder::open(empty.path()).unwrap_err().to_string().contains("recording.toml"));
}

pub(super) fn inspected(kind: &str, folder: &Path) -> Inspection {
    let mut seen = 0;
    let found = inspect(&*open(kind, folder).unwrap(), |done| seen = done);
    assert_eq!(seen, found.frames);
    found
}

#[test]
fn an_inspection_says_what_is_there() {
    let folder = replica();
    let found = inspected("replica", folder.path());
    assert_eq!((found.frames, found.readable, found.with_pose, found.has_masks), (3, 3, 3, true));
    assert_eq!((found.size, found.camera), ([24, 16], [17.0, 18.0, 11.5, 7.5]));
    let depth = found.depth.unwrap();
    assert_eq!(depth.measured, 1.0);
    assert!((depth.median_metres - 0.918).abs() < 0.002, "{depth:?}");
    assert!((found.seconds - 2.0 / 30.0).abs() < 1e-6 && found.metres == Some(2.0));
    assert_eq!(found.no_pose, None);
    assert!(found.assumed.is_empty() && found.left_out.is_empty());
    // The camera goes a metre in each thirtieth of a second up to its limit for a jump.
    assert_eq!(found.problems, Vec::<String>::new());
}

#[test]
fn an_inspection_says_what_is_wrong() {
    let folder = replica();
    let f = folder.path();
    put(f, "results/frame000001.jpg", "no picture");
    put(f, "traj.txt", format!("{IDENTITY}\n{IDENTITY}\n1 0 0 9 0 1 0 0 0 0 1 0 0 0 0 1\n"));
    put(f, "results/frame000009.jpg", "");
    let found = inspected("replica", f);
    assert_eq!((found.frames, found.readable, found.left_out.len()), (3, 2, 1));
    assert!(found.problems[0].contains("frame 1:") && found.problems[0].contains("JPEG or PNG"));
    assert!(found.problems[1].contains("frame 2: the camera moves 9.00 m in 0.07 s"), "{found:?}");
    put_color(f, "results/frame000001.jpg", (9, 9));
    let camera = fs::read_to_string(f.join("cam_params.json")).unwrap();
    put(f, "cam_params.json", camera.replace("6553.5", "100.0"));
    fs::remove_file(f.join("traj.txt")).unwrap();
    let found = inspected("replica", f);
    assert!(found.problems[0].contains("color: expected 24x16 pixels, found 9x9"), "{found:?}");
    assert!(found.problems[1].contains("is the unit of depth right?"), "{found:?}");
    assert!(found.no_pose.unwrap().contains("there is no such file"));
    assert_eq!((found.with_pose, found.metres), (0, None));
    for number in 0..3 {
        put_depth(f, &format!("results/depth{number:06}.png"), |_, _| 0);
    }
    let found = inspected("replica", f);
    assert_eq!(found.problems[1], "no frame that was looked at has depth");
}

#[test]
fn layouts_without_times_take_a_rate() {
    let rate = FrameRate::try_from(12.5).unwrap();
    let folders = [nerfstudio(|_| ()), replica(), seven_scenes()];
    let [one, two, three] = folders.each_ref().map(TempDir::path);
    let open = |rate| -> [Box<dyn Dataset>; 3] {
        [
            Box::new(Nerfstudio::open(one).unwrap().at_rate(rate)),
            Box::new(Replica::open(two).unwrap().at_rate(rate)),
            Box::new(SevenScenes::open(three).unwrap().at_rate(rate)),
        ]
    };
    for (dataset, usual) in open(rate).iter().zip(open(FrameRate::default())) {
        let last = dataset.len() - 1;
        let nanos = dataset.sequence(last) * 80_000_000;
        assert_eq!(dataset.moment(last).unwrap().timestamp_nanos, nanos);
        assert_eq!(dataset.frame(last).unwrap().timestamp_nanos, nanos);
        // Negative control: 30 frames a second if nobody says so.
        let thirtieths = dataset.sequence(last) * 1_000_000_000 / 30;
        assert_eq!(usual.moment(last).unwrap().timestamp_nanos, thirtieths);
    }
    for wrong in [0.0, -3.0, f64::NAN, f64::INFINITY, 1e5] {
        let error = FrameRate::try_from(wrong).unwrap_err();
        assert!(error.starts_with("frames_per_second: expected 0.001 to 10000, found"), "{error}");
    }
}
