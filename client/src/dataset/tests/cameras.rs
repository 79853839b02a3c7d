//! Cameras as they are in folders: distortion, depth of another camera, turned pictures, confidence, arrays.

use super::formats::{DESCRIPTION, described, inspected, nerfstudio};
use super::*;
use crate::dataset::{DepthCamera, DepthCameraSeen, DistortionSeen};
use nalgebra::{UnitQuaternion, Vector3};

const DEPTH_SIZE: (u32, u32) = (6, 4);

/// A phone's pictures: color upright, depth and confidence as the sensor lies, turned to the left and
/// smaller.
pub(super) fn phone() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let f = folder.path();
    for number in [1, 3] {
        put_color(f, &format!("color/{number}.png"), (16, 24));
        let depth = ImageBuffer::from_fn(DEPTH_SIZE.0, DEPTH_SIZE.1, |x, y| {
            Luma([(1000 + 100 * x + y) as u16])
        });
        fs::create_dir_all(f.join("depth")).unwrap();
        depth.save(f.join(format!("depth/{number}.png"))).unwrap();
        let sure = GrayImage::from_fn(DEPTH_SIZE.0, DEPTH_SIZE.1, |x, _| Luma([x as u8]));
        fs::create_dir_all(f.join("confidence")).unwrap();
        sure.save(f.join(format!("confidence/{number}.png"))).unwrap();
    }
    put(
        f,
        "recording.toml",
        r#"
        up = [0.0, 0.0, 1.0]
        [color]
        files = "color/*.png"
        [depth]
        files = "depth/*.png"
        unit_metres = 0.001
        turned = 90
        confidence = "confidence/*.png"
        least_confidence = 2
        max_metres = 5.0
        no_depth = [1301]
        [depth.camera]
        same_lens = true
        [camera]
        fx = 18.0
        fy = 18.0
        cx = 7.5
        cy = 11.5
        "#,
    );
    folder
}

#[test]
fn a_phones_depth_is_turned_and_what_is_not_sure_is_left_out() {
    let folder = phone();
    let dataset = Folder::open(folder.path()).unwrap();
    let cameras = dataset.cameras();
    assert_eq!(cameras.depth, Some(DepthCamera::SameLens { width: 4, height: 6 }));
    assert_eq!((cameras.depth_range_metres, &*cameras.no_depth), (Some([0.0, 5.0]), &[1301][..]));
    assert_eq!((cameras.up, dataset.sequence(1)), (Some([0.0, 0.0, 1.0]), 3));
    let depth = units(&dataset.frame(0).unwrap().depth);
    assert_eq!(depth.dimensions(), (4, 6));
    // Clockwise: the bottom row becomes the first column.
    assert_eq!((depth[(0, 5)][0], depth[(3, 5)][0]), (1503, 1500));
    assert_eq!((depth[(0, 2)][0], depth[(0, 1)][0]), (1203, 0), "confidence 2 and 1");
    let found = inspected("folder", folder.path());
    assert_eq!((found.readable, &*found.problems), (2, &[][..]));
    let seen = found.depth_camera.unwrap();
    assert_eq!((seen.size, seen.camera), ([4, 6], None));
    // Two columns of six are not sure, and one pixel of 24 is no measurement.
    assert!((found.depth.unwrap().measured - 15.0 / 24.0).abs() < 1e-9, "{:?}", found.depth);
    let text = fs::read_to_string(folder.path().join("recording.toml")).unwrap();
    for (degrees, size, first) in [(0, (6, 4), 0), (180, (6, 4), 1503), (270, (4, 6), 1500)] {
        let turned = format!("turned = {degrees}");
        put(folder.path(), "recording.toml", text.replace("turned = 90", &turned));
        let depth = units(&Folder::open(folder.path()).unwrap().frame(0).unwrap().depth);
        assert_eq!((depth.dimensions(), depth[(0, 0)][0]), (size, first), "{degrees}");
    }
    put_color(folder.path(), "confidence/3.png", (3, 3));
    let error = Folder::open(folder.path()).unwrap().frame(1).unwrap_err().to_string();
    assert!(error.contains("expected grey confidence"), "{error}");
}

#[test]
fn color_is_turned_in_its_own_format() {
    for (name, format) in [("jpg", ColorFormat::Jpeg), ("png", ColorFormat::Png)] {
        let folder = phone();
        let f = folder.path();
        for number in [1, 3] {
            fs::remove_file(f.join(format!("color/{number}.png"))).unwrap();
            let lit = |x: u32, y: u32| image::Rgb([if x < 8 && y < 8 { 250 } else { 9 }; 3]);
            let picture = RgbImage::from_fn(24, 16, lit);
            picture.save(f.join(format!("color/{number}.{name}"))).unwrap();
        }
        let text = fs::read_to_string(f.join("recording.toml")).unwrap();
        let turned = format!("files = \"color/*.{name}\"\nturned = 90");
        put(f, "recording.toml", text.replace("files = \"color/*.png\"", &turned));
        let dataset = Folder::open(f).unwrap();
        assert_eq!((dataset.intrinsics().width, dataset.intrinsics().height), (16, 24));
        let color = dataset.frame(0).unwrap().color;
        let picture = image::load_from_memory(&color.bytes).unwrap().into_rgb8();
        assert_eq!((color.format, picture.dimensions()), (format, (16, 24)));
        // The corner at the top left is at the top right now.
        assert!(picture[(13, 2)][0] > 240 && picture[(2, 2)][0] < 20, "{name}");
    }
}

const OWN: &str = r#"
distortion = { model = "rational_polynomial", coefficients = [0.1, 0.2, 0, 0, 0.3, 0, 0, 0.4] }
[depth.camera]
fx = 4.0
fy = 5.0
cx = 2.5
cy = 1.5
distortion = { model = "equidistant", coefficients = [0.01, 0, 0, 0] }
color_from_depth = { translation = [0.015, 0, 0], quaternion = [0, 0, 0.7071068, 0.7071068] }
"#;

/// A folder whose depth has a camera of its own.
fn own() -> TempDir {
    let folder = described("");
    let f = folder.path();
    for number in [0, 2, 10] {
        let depth = ImageBuffer::from_fn(DEPTH_SIZE.0, DEPTH_SIZE.1, |_, _| Luma([700_u16]));
        depth.save(f.join(format!("depth/{number}.png"))).unwrap();
    }
    put(f, "recording.toml", format!("{DESCRIPTION}{OWN}"));
    folder
}

#[test]
fn depth_may_have_a_camera_of_its_own() {
    let folder = own();
    let dataset = Folder::open(folder.path()).unwrap();
    let cameras = dataset.cameras();
    let bent = vec![0.1, 0.2, 0.0, 0.0, 0.3, 0.0, 0.0, 0.4];
    assert_eq!(cameras.color.distortion, Distortion::BrownConrady(bent.clone()));
    let Some(DepthCamera::Own { camera, color_from_depth }) = cameras.depth else { panic!() };
    assert_eq!(camera.distortion, Distortion::KannalaBrandt([0.01, 0.0, 0.0, 0.0]));
    assert_eq!((camera.intrinsics.width, camera.intrinsics.fy), (6, 5.0));
    let quarter = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
    assert!(color_from_depth.rotation.angle_to(&quarter) < 1e-6);
    assert_eq!(color_from_depth.translation.x, 0.015);
    let found = inspected("folder", folder.path());
    assert_eq!((found.readable, &*found.problems), (3, &[][..]));
    assert_eq!(
        found.distortion,
        Some(DistortionSeen { model: "brown_conrady", coefficients: bent })
    );
    let seen: DepthCameraSeen = found.depth_camera.unwrap();
    assert_eq!((seen.size, seen.camera), ([6, 4], Some([4.0, 5.0, 2.5, 1.5])));
    assert!((seen.turned_degrees - 90.0).abs() < 1e-3);
    // A matrix says the same.
    let matrix = "matrix = [0, -1, 0, 0.015, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]";
    let text = format!("{DESCRIPTION}{OWN}");
    let (before, after) = text.split_once("translation").unwrap();
    let rest = after.split_once(']').unwrap().1.split_once(']').unwrap().1;
    put(folder.path(), "recording.toml", format!("{before}{matrix}{rest}"));
    let Some(DepthCamera::Own { color_from_depth: same, .. }) =
        Folder::open(folder.path()).unwrap().cameras().depth
    else {
        panic!()
    };
    assert!((same.inverse() * color_from_depth).rotation.angle() < 1e-6);
    // Each picture is compared with its own camera.
    put_depth(folder.path(), "depth/2.png", |_, _| 700);
    let found = inspected("folder", folder.path());
    assert!(found.problems[0].contains("depth: expected 6x4 pixels, found 24x16"), "{found:?}");
}

#[test]
fn wrong_cameras_say_what_is_wrong() {
    for (old, new, expected) in [
        ("fx = 4.0\n", "", "depth.camera: expected fx, fy, cx and cy, or same_lens"),
        ("fx = 4.0\n", "fx = 4.0\nsame_lens = true\n", "expected nothing beside same_lens"),
        ("rational_polynomial", "thin_prism", "camera: distortion: expected distortion model"),
        (", 0.3, 0, 0, 0.4]", ", 0.3, 0, 0.4]", "expected 4, 5 or 8 coefficients"),
        ("[0.01, 0, 0, 0]", "[0.01]", "expected 4 coefficients, found 1"),
        ("0, 0.7071068, 0.7071068", "0, 0, 7", "quaternion of length 1"),
        ("translation", "matrix", "expected translation and quaternion"),
        ("unit_metres = 0.002", "unit_metres = 1\nmin_metres = 3\nmax_metres = 2", "< max_metres"),
        ("unit_metres = 0.002", "unit_metres = 1\nturned = 45", "expected 0, 90, 180 or 270"),
        ("unit_metres = 0.002", "unit_metres = 1\nconfidence = \"c/*.png\"", "both of confidence"),
    ] {
        let folder = own();
        let text = format!("{DESCRIPTION}{OWN}");
        assert!(text.contains(old), "{old}");
        put(folder.path(), "recording.toml", text.replacen(old, new, 1));
        let error = Folder::open(folder.path()).unwrap_err().to_string();
        assert!(error.contains(expected), "{new}: {error}");
    }
    let folder = own();
    put(folder.path(), "recording.toml", DESCRIPTION);
    let error = Folder::open(folder.path()).unwrap_err().to_string();
    assert!(error.contains("color is 24x16 pixels, depth 6x4: say in [depth.camera]"), "{error}");
}

/// A `.npy` file of float32, `rows` by `columns`.
fn array(rows: usize, columns: usize, values: &[f32]) -> Vec<u8> {
    let header =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({rows}, {columns}), }}\n");
    let length = (header.len() as u16).to_le_bytes();
    let values = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    [b"\x93NUMPY\x01\x00".to_vec(), length.to_vec(), header.into_bytes(), values].concat()
}

#[test]
fn depth_may_be_arrays() {
    let metres = [1.5, f32::NAN, 0.0, 2.0005, 99.0, -1.0];
    let folder = own();
    let f = folder.path();
    let npy = |number: u32| format!("depth/{number}.npy");
    [0, 2, 10].iter().for_each(|number| put(f, &npy(*number), array(2, 3, &metres)));
    let text = format!("{DESCRIPTION}{OWN}").replace("depth/*.png", "depth/*.npy");
    put(f, "recording.toml", text.replace("unit_metres = 0.002", "unit_metres = 1.0"));
    let dataset = Folder::open(f).unwrap();
    let depth = units(&dataset.frame(0).unwrap().depth);
    assert_eq!((depth.dimensions(), dataset.depth_unit_metres()), ((3, 2), 0.00025));
    assert_eq!(depth.into_raw(), [6000, 0, 0, 8002, 0, 0]);
    put(f, &npy(2), array(2, 3, &metres[1..]));
    let error = dataset.frame(1).unwrap_err().to_string();
    assert!(error.contains("2.npy: npy data: expected float32 of shape [2, 3]"), "{error}");

    // Nerfstudio's arrays are in its unit, and so are its poses in its scale.
    let arrays = |list: &mut serde_json::Value| {
        list["applied_scale"] = 0.5.into();
        for number in 0..3 {
            list["frames"][number]["depth_file_path"] = format!("depth/{number}.npy").into();
        }
    };
    let folder = nerfstudio(arrays);
    let values = array(2, 3, &[1500.0; 6]);
    (0..3).for_each(|number| put(folder.path(), &npy(number), &values));
    let dataset = Nerfstudio::open(folder.path()).unwrap();
    assert_eq!(units(&dataset.frame(0).unwrap().depth)[(0, 0)][0], 6000);
    assert!(dataset.notes()[0].contains("are taken to be millimetres"), "{:?}", dataset.notes());
    let place = dataset.frame(2).unwrap().world_from_camera.unwrap().translation;
    assert!((place.x - 2.0).abs() < 1e-9, "{place}");
    let folder = nerfstudio(|list| {
        arrays(list);
        list["depth_unit_scale_factor"] = 0.002.into();
    });
    let values = array(2, 3, &[1500.0; 6]);
    (0..3).for_each(|number| put(folder.path(), &npy(number), &values));
    let dataset = Nerfstudio::open(folder.path()).unwrap();
    assert_eq!(units(&dataset.frame(0).unwrap().depth)[(0, 0)][0], 12000);
    assert!(dataset.notes().is_empty());
}

#[test]
fn nerfstudios_lenses_are_used() {
    let open = |change: &dyn Fn(&mut serde_json::Value)| {
        let folder = nerfstudio(change);
        Nerfstudio::open(folder.path())
    };
    let bent = |list: &mut serde_json::Value| {
        (list["k1"], list["p2"], list["k3"]) = (0.1.into(), 0.02.into(), 0.3.into());
    };
    let dataset = open(&bent).unwrap();
    let expected = Distortion::BrownConrady(vec![0.1, 0.0, 0.0, 0.02, 0.3]);
    assert_eq!(dataset.cameras().color.distortion, expected);
    let fisheye = |list: &mut serde_json::Value| {
        list["camera_model"] = "OPENCV_FISHEYE".into();
        (list["k1"], list["k4"]) = (0.1.into(), 0.4.into());
    };
    let expected = Distortion::KannalaBrandt([0.1, 0.0, 0.0, 0.4]);
    assert_eq!(open(&fisheye).unwrap().cameras().color.distortion, expected);
    let error = open(&|list| list["k4"] = 0.4.into()).unwrap_err().to_string();
    assert!(error.contains("k4: expected 0 with OPENCV, found 0.4"), "{error}");
    // A frame with a focal length of its own, and one with a lens that cannot be told.
    let folder = nerfstudio(|list| {
        list["frames"][0]["fl_x"] = 20.0.into();
        list["frames"][1]["k1"] = 0.5.into();
    });
    let dataset = Nerfstudio::open(folder.path()).unwrap();
    let own = |at: usize| dataset.frame(at).unwrap().extras.intrinsics;
    assert_eq!((own(0), own(2)), (None, None));
    assert_eq!(own(1).unwrap(), Intrinsics { fx: 20.0, ..dataset.intrinsics() });
    let [note] = dataset.notes() else { panic!("{:?}", dataset.notes()) };
    assert!(note.contains("frame_10.png: its own distortion is not used"), "{note}");
    // Pictures of half the size that the list says.
    let dataset = open(&|list| {
        (list["w"], list["h"]) = (48.into(), 32.into());
    })
    .unwrap();
    let Intrinsics { width, fx, cx, .. } = dataset.intrinsics();
    assert_eq!((width, fx, cx), (24, 8.5, 5.5));
}
