//! Messages of every schema, written as senders write them, and damaged ones.

use super::{Calibration, Content, Decoder, Kind, MessageError, Picture, Reading, Region};
use crate::dataset::tests::mutations::{mutate, mutations};
use crate::dataset::{ColorFormat, Depth, DepthFormat, Distortion, Intrinsics};
use byteorder::{BigEndian, LittleEndian};
use foxglove::messages as fox;
use image::{ImageFormat, Luma, Rgb};
use prost::Message as _;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use serde::Serialize;
use serde_json::json;
use std::io::Cursor;

const NANOS: u64 = 1_700_000_000_250_000_000;
/// A time and a frame of coordinates.
type Header = ((i32, u32), &'static str);
const HEADER: Header = ((1_700_000_000, 250_000_000), "camera");
const QUARTER: [f64; 4] =
    [0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2];

/// A message of ROS 2, of a machine with the low byte first.
fn cdr(message: impl Serialize) -> Vec<u8> {
    let body = cdr_encoding::to_vec::<_, LittleEndian>(&message).unwrap();
    [&[0, 1, 0, 0], &body[..]].concat()
}

fn ros(schema: &str) -> Decoder {
    Decoder::of("cdr", schema).unwrap()
}

fn picture<'a>(decoder: Decoder, data: &'a [u8]) -> Picture<'a> {
    assert_eq!(decoder.kind(), Kind::Picture);
    match decoder.read(data) {
        Ok(Reading::Picture(picture)) => picture,
        other => panic!("{other:?}"),
    }
}

fn raw(size: [u32; 2], encoding: &str, step: u32, is_big_endian: bool, data: &[u8]) -> Vec<u8> {
    let [width, height] = size;
    cdr((HEADER, height, width, encoding, u8::from(is_big_endian), step, data))
}

fn compressed(format: &str, data: &[u8]) -> Vec<u8> {
    cdr((HEADER, format, data))
}

fn png<P: image::PixelWithColorType>(pixels: &image::ImageBuffer<P, Vec<P::Subpixel>>) -> Vec<u8>
where
    [P::Subpixel]: image::EncodableLayout,
{
    let mut bytes = Cursor::new(Vec::new());
    pixels.write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}

fn depth_png() -> Vec<u8> {
    png(&image::ImageBuffer::from_fn(4, 2, |x, y| Luma([(1000 * y + x) as u16])))
}

#[test]
fn raw_colors_become_rgb() {
    let image = ros("sensor_msgs/msg/Image");
    let cases: [(&str, u32, &[u8], [u8; 6]); 8] = [
        ("rgb8", 6, &[1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 6]),
        ("bgr8", 6, &[1, 2, 3, 4, 5, 6], [3, 2, 1, 6, 5, 4]),
        ("rgba8", 8, &[1, 2, 3, 9, 4, 5, 6, 9], [1, 2, 3, 4, 5, 6]),
        ("bgra8", 8, &[1, 2, 3, 9, 4, 5, 6, 9], [3, 2, 1, 6, 5, 4]),
        ("mono8", 2, &[7, 8], [7, 7, 7, 8, 8, 8]),
        // White and black; and red, whose lightness is 82 and whose differences are 90 and 240.
        ("yuv422_yuy2", 4, &[235, 128, 16, 128], [255, 255, 255, 0, 0, 0]),
        ("yuyv", 4, &[82, 90, 82, 240], [255, 1, 0, 255, 1, 0]),
        ("uyvy", 4, &[90, 82, 240, 82], [255, 1, 0, 255, 1, 0]),
    ];
    for (encoding, step, row, expected) in cases {
        // Two rows, each with two bytes behind it.
        let data = [row, &[99, 99], row, &[99, 99]].concat();
        let message = raw([2, 2], encoding, step + 2, false, &data);
        let picture = picture(image, &message);
        assert_eq!((picture.nanos, &*picture.frame_id), (NANOS, "camera"));
        let content = if encoding == "mono8" { Content::Grey } else { Content::Color };
        assert_eq!((picture.content(), picture.size()), (Ok(content), Ok((2, 2))));
        let color = picture.color().unwrap();
        assert_eq!(color.bytes, expected.repeat(2), "{encoding}");
        assert_eq!(color.format, ColorFormat::Rgb8);
        assert!(picture.depth().is_err(), "it is no depth");
        // Bytes between the last row and the end may be missing; pixels not.
        for (cut, is_whole) in [(2, true), (3, false)] {
            let message = raw([2, 2], encoding, step + 2, false, &data[..data.len() - cut]);
            assert_eq!(picture_of(image, &message).color().is_ok(), is_whole, "{encoding}");
        }
    }
    let message = raw([2, 2], "bayer_rggb8", 2, false, &[0; 4]);
    let error = picture_of(image, &message).color().unwrap_err().to_string();
    assert!(error.contains("\"bayer_rggb8\" is not read"), "{error}");
}

fn picture_of<'a>(decoder: Decoder, data: &'a [u8]) -> Picture<'a> {
    picture(decoder, data)
}

#[test]
fn raw_depth_has_the_low_byte_first() {
    let image = ros("sensor_msgs/msg/Image");
    let cases = [
        ("16UC1", false, vec![0xe8, 3, 0, 1], DepthFormat::U16, vec![0xe8, 3, 0, 1]),
        ("mono16", true, vec![3, 0xe8, 1, 0], DepthFormat::U16, vec![0xe8, 3, 0, 1]),
        ("32FC1", false, 2.5_f32.to_le_bytes().repeat(2), DepthFormat::F32Metres, Vec::new()),
        ("32FC1", true, 2.5_f32.to_be_bytes().repeat(2), DepthFormat::F32Metres, Vec::new()),
    ];
    for (encoding, is_big_endian, data, format, expected) in cases {
        let message = raw([2, 1], encoding, data.len() as u32, is_big_endian, &data);
        let picture = picture(image, &message);
        assert_eq!(picture.content(), Ok(Content::Depth));
        let metres = 2.5_f32.to_le_bytes().repeat(2);
        let bytes = if expected.is_empty() { metres } else { expected };
        assert_eq!(picture.depth(), Ok(Depth { format, bytes }), "{encoding} {is_big_endian}");
        assert!(picture.color().is_err(), "it has no color");
    }
}

#[test]
fn compressed_pictures_stay_as_they_are() {
    let image = ros("sensor_msgs/msg/CompressedImage");
    let mut jpeg = Cursor::new(Vec::new());
    let color = image::RgbImage::from_pixel(4, 2, Rgb([200, 10, 10]));
    color.write_to(&mut jpeg, ImageFormat::Jpeg).unwrap();
    let grey = png(&image::GrayImage::from_pixel(4, 2, Luma([9])));
    for (format, bytes, content) in [
        ("jpeg", jpeg.into_inner(), Content::Color),
        ("bgr8; png compressed bgr8", png(&color), Content::Color),
        ("mono8; png compressed ", grey, Content::Grey),
        ("16UC1; png compressed ", depth_png(), Content::Depth),
    ] {
        let message = compressed(format, &bytes);
        let picture = picture(image, &message);
        assert_eq!((picture.content(), picture.size()), (Ok(content), Ok((4, 2))), "{format}");
        match content {
            Content::Depth => assert_eq!(picture.depth().unwrap().bytes, bytes),
            _ => assert_eq!(picture.color().unwrap().bytes, bytes),
        }
    }
    let message = compressed("16UC1; jpeg compressed mono8", &[0xff, 0xd8, 0xff]);
    let error = picture(image, &message).content().unwrap_err().to_string();
    assert!(error.contains("publish compressedDepth"), "{error}");
    let message = compressed("webp", b"RIFF");
    assert!(picture(image, &message).content().is_err());
}

#[test]
fn compressed_depth_has_a_header() {
    let image = ros("sensor_msgs/msg/CompressedImage");
    let read = |format: &str, data: &[u8]| {
        let message = compressed(format, data);
        let picture = picture(image, &message);
        assert_eq!(picture.content(), Ok(Content::Depth));
        (picture.size(), picture.depth())
    };
    let header = |a: f32, b: f32| [[0; 4], a.to_le_bytes(), b.to_le_bytes()].concat();
    let png = depth_png();
    let millimetres = Depth { format: DepthFormat::Png16, bytes: png.clone() };
    for (format, data) in [
        ("16UC1; compressedDepth png", [header(0.0, 0.0), png.clone()].concat()),
        ("16UC1; compressedDepth", png.clone()),
    ] {
        assert_eq!(read(format, &data), (Ok((4, 2)), Ok(millimetres.clone())), "{format}");
    }
    // Metres are A / (q - B).
    let (size, depth) = read("32FC1; compressedDepth png", &[header(500.0, -10.0), png].concat());
    let Depth { format, bytes } = depth.unwrap();
    assert_eq!((size, format), (Ok((4, 2)), DepthFormat::F32Metres));
    let metres: Vec<f32> =
        bytes.chunks_exact(4).map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap())).collect();
    assert!(metres[0].is_nan());
    let expected = [1.0, 2.0, 3.0, 1000.0, 1001.0, 1002.0, 1003.0].map(|q| 500.0 / (q + 10.0));
    assert_eq!(metres[1..], expected);
    // One zero and one value, 1 and +7: the groups 1, 1, 14 (6 and more), 1.
    let rvl =
        [&header(0.0, 0.0)[..], &2_u32.to_le_bytes(), &1_u32.to_le_bytes(), &[0, 0, 0xe1, 0x11]];
    let (size, depth) = read("16UC1; compressedDepth rvl", &rvl.concat());
    assert_eq!((size, depth.unwrap().bytes), (Ok((2, 1)), vec![0, 0, 7, 0]));
    let huge = [&header(0.0, 0.0)[..], &[255; 8]].concat();
    let (size, depth) = read("16UC1; compressedDepth rvl", &huge);
    assert!(size.is_err() && depth.is_err());
    assert!(read("16UC1; compressedDepth png", b"short").1.is_err());
}

fn calibration_message(model: &str, d: &[f64], binning: [u32; 2], region: Region) -> Vec<u8> {
    let k = [500.0, 0.0, 319.5, 0.0, 510.0, 239.5, 0.0, 0.0, 1.0];
    let p = [480.0, 0.0, 310.0, 0.0, 0.0, 490.0, 230.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let Region { x, y, width, height } = region;
    let region = (x, y, height, width, false);
    cdr((HEADER, 480_u32, 640_u32, model, d, k, k, p, (binning[0], binning[1], region)))
}

fn calibration(data: &[u8]) -> Calibration {
    match ros("sensor_msgs/msg/CameraInfo").read(data) {
        Ok(Reading::Calibration(calibration)) => calibration,
        other => panic!("{other:?}"),
    }
}

#[test]
fn calibrations_give_the_camera_of_the_pictures() {
    let of = |model: &str, d: &[f64]| {
        let found = calibration(&calibration_message(model, d, [0, 0], Region::default()));
        let found = found.of_pictures((640, 480), false).unwrap();
        (found.camera.distortion, found.notes.len())
    };
    let five = [0.1, -0.2, 0.001, 0.002, 0.03];
    let eight = [0.1, -0.2, 0.001, 0.002, 0.03, 0.4, 0.5, 0.6];
    assert_eq!(of("plumb_bob", &five), (Distortion::BrownConrady(five.to_vec()), 0));
    assert_eq!(of("plumb_bob", &[0.0; 5]), (Distortion::None, 0));
    assert_eq!(of("rational_polynomial", &eight), (Distortion::BrownConrady(eight.to_vec()), 0));
    let fourteen = [&eight[..], &[0.0; 6]].concat();
    assert_eq!(of("rational_polynomial", &fourteen), (Distortion::BrownConrady(eight.to_vec()), 0));
    let prism = [&eight[..], &[0.1; 4]].concat();
    assert_eq!(of("rational_polynomial", &prism), (Distortion::BrownConrady(eight.to_vec()), 1));
    let four = [0.1, 0.2, 0.3, 0.4];
    assert_eq!(of("equidistant", &four), (Distortion::KannalaBrandt(four), 0));
    assert_eq!(of("mirror_ball", &four), (Distortion::None, 1), "it is told of");

    let found = calibration(&calibration_message("plumb_bob", &five, [0, 0], Region::default()));
    let rectified = found.of_pictures((640, 480), true).unwrap().camera;
    let lens = Intrinsics { width: 640, height: 480, fx: 480.0, fy: 490.0, cx: 310.0, cy: 230.0 };
    assert_eq!((rectified.intrinsics, rectified.distortion), (lens, Distortion::None));
    let half = found.of_pictures((320, 240), false).unwrap();
    assert_eq!((half.camera.intrinsics.fx, half.camera.intrinsics.cx), (250.0, 159.5));
    assert_eq!(half.notes.len(), 1, "it is told of");
    assert!(found.of_pictures((0, 0), false).is_err());
    let error = found.of_pictures((640, 400), false).unwrap_err().to_string();
    assert!(error.contains("640x480") && error.contains("640x400"), "{error}");

    let region = Region { x: 100, y: 60, width: 320, height: 240 };
    let part = calibration(&calibration_message("plumb_bob", &five, [2, 2], region));
    let Intrinsics { fx, cx, cy, width, .. } =
        part.of_pictures((160, 120), false).unwrap().camera.intrinsics;
    assert_eq!((width, fx, cx, cy), (160, 250.0, 109.5, 89.5));

    let unknown = Calibration { k: [0.0; 9], ..found };
    let error = unknown.of_pictures((640, 480), false).unwrap_err().to_string();
    assert!(error.contains("calibrate it"), "{error}");
}

#[test]
fn poses_of_ros_are_rigid_transforms() {
    let pose = ([1.0, 2.0, 3.0], QUARTER);
    let stamped = (HEADER, "base", pose);
    let covariance = [0.5; 32];
    let tf = cdr((vec![stamped, (HEADER, "arm", pose)],));
    let cases = [
        ("tf2_msgs/msg/TFMessage", Kind::Transforms, tf, 2),
        ("geometry_msgs/msg/TransformStamped", Kind::Odometry, cdr(stamped), 1),
        ("nav_msgs/msg/Odometry", Kind::Odometry, cdr((HEADER, "base", pose, covariance)), 1),
    ];
    for (schema, kind, message, count) in cases {
        assert_eq!(ros(schema).kind(), kind);
        let Ok(Reading::Transforms(all)) = ros(schema).read(&message) else { panic!("{schema}") };
        assert_eq!(all.len(), count);
        let first = &all[0];
        assert_eq!((&*first.parent, &*first.child, first.nanos), ("camera", "base", NANOS));
        let moved = first.parent_from_child * nalgebra::Point3::new(1.0, 0.0, 0.0);
        assert!((moved - nalgebra::Point3::new(1.0, 3.0, 3.0)).norm() < 1e-12, "{moved}");
    }
    for schema in ["geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped"] {
        let message = cdr((HEADER, pose, covariance));
        let Ok(Reading::Pose(found)) = ros(schema).read(&message) else { panic!("{schema}") };
        assert_eq!(
            (found.nanos, &*found.frame_id, found.pose.translation.z),
            (NANOS, "camera", 3.0)
        );
    }
    // Negative controls: no rotation, and no number.
    for pose in [([0.0; 3], [0.0; 4]), ([f64::NAN; 3], QUARTER)] {
        let error = ros("geometry_msgs/msg/PoseStamped").read(&cdr((HEADER, pose))).unwrap_err();
        assert!(matches!(error, MessageError::Content(_)), "{error}");
    }
}

#[test]
fn a_still_imu_knows_what_is_up() {
    let imu = |acceleration: [f64; 3]| {
        let message = cdr((HEADER, [0.0; 4], [0.0; 9], [0.0; 3], [0.0; 9], acceleration, [0.0; 9]));
        match ros("sensor_msgs/msg/Imu").read(&message) {
            Ok(Reading::Gravity(gravity)) => gravity.map(|gravity| gravity.up),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(imu([0.0, -9.8, 0.0]).unwrap().y, -1.0);
    assert_eq!(imu([5.0, -9.8, 0.0]), None, "it is shaken");
}

#[test]
fn either_order_of_bytes_is_read() {
    let message = (HEADER, ([1.0, 2.0, 3.0], QUARTER));
    let body = cdr_encoding::to_vec::<_, BigEndian>(&message).unwrap();
    let schema = ros("geometry_msgs/msg/PoseStamped");
    let (big, little) = ([&[0, 0, 0, 0], &body[..]].concat(), cdr(message));
    assert_eq!(schema.read(&big), schema.read(&little));
    let mut other = little;
    other[1] = 7;
    let error = schema.read(&other).unwrap_err().to_string();
    assert!(error.contains("expected plain CDR, found encapsulation 0 7"), "{error}");
    assert!(schema.read(&[0]).is_err());
    assert_eq!(Decoder::of("cdr", "sensor_msgs/msg/LaserScan"), None);
    assert_eq!(Decoder::of("ros1", "sensor_msgs/msg/Image"), None);
}

fn fox_time() -> Option<fox::Timestamp> {
    Some(fox::Timestamp::new(1_700_000_000, 250_000_000))
}

/// The same messages in protobuf and in JSON, by the names of their schemas.
fn fox_messages() -> Vec<(&'static str, Vec<u8>, Vec<u8>)> {
    let time = json!({"sec": 1_700_000_000, "nsec": 250_000_000});
    let frame_id = "camera".to_owned();
    let raw = fox::RawImage {
        timestamp: fox_time(),
        frame_id: frame_id.clone(),
        width: 2,
        height: 1,
        encoding: "bgr8".into(),
        step: 6,
        data: vec![1, 2, 3, 4, 5, 6].into(),
    };
    let raw_json = json!({"timestamp": time, "frame_id": "camera", "width": 2, "height": 1,
        "encoding": "bgr8", "step": 6, "data": "AQIDBAUG"});
    let k = vec![500.0, 0.0, 319.5, 0.0, 510.0, 239.5, 0.0, 0.0, 1.0];
    let lens = fox::CameraCalibration {
        timestamp: fox_time(),
        frame_id: frame_id.clone(),
        width: 640,
        height: 480,
        distortion_model: "plumb_bob".into(),
        d: vec![0.1; 5],
        k: k.clone(),
        ..Default::default()
    };
    let lens_json = json!({"timestamp": time, "frame_id": "camera", "width": 640, "height": 480,
        "distortion_model": "plumb_bob", "D": [0.1, 0.1, 0.1, 0.1, 0.1], "K": k, "R": [], "P": []});
    let [x, y, z, w] = QUARTER;
    let place = Some(fox::Vector3 { x: 1.0, y: 2.0, z: 3.0 });
    let turn = Some(fox::Quaternion { x, y, z, w });
    let (place_json, turn_json) =
        (json!({"x": 1, "y": 2, "z": 3}), json!({"x": x, "y": y, "z": z, "w": w}));
    let transform = fox::FrameTransform {
        timestamp: fox_time(),
        parent_frame_id: "world".into(),
        child_frame_id: frame_id,
        translation: place,
        rotation: turn,
    };
    let transform_json = json!({"timestamp": time, "parent_frame_id": "world", "child_frame_id": "camera",
        "translation": place_json, "rotation": turn_json});
    let all = fox::FrameTransforms { transforms: vec![transform.clone()] };
    let posed = fox::PoseInFrame {
        timestamp: fox_time(),
        frame_id: "world".into(),
        pose: Some(fox::Pose { position: place, orientation: turn }),
    };
    let posed_json = json!({"timestamp": time, "frame_id": "world",
        "pose": {"position": place_json, "orientation": turn_json}});
    let compressed = fox::CompressedImage {
        timestamp: fox_time(),
        frame_id: "camera".into(),
        data: depth_png().into(),
        format: "png".into(),
    };
    let compressed_json = serde_json::to_value(&compressed).unwrap();
    let all_json = json!({"transforms": [transform_json]});
    [
        ("foxglove.RawImage", raw.encode_to_vec(), raw_json),
        ("foxglove.CompressedImage", compressed.encode_to_vec(), compressed_json),
        ("foxglove.CameraCalibration", lens.encode_to_vec(), lens_json),
        ("foxglove.FrameTransform", transform.encode_to_vec(), transform_json),
        ("foxglove.FrameTransforms", all.encode_to_vec(), all_json),
        ("foxglove.PoseInFrame", posed.encode_to_vec(), posed_json),
    ]
    .map(|(schema, bytes, json)| (schema, bytes, json.to_string().into_bytes()))
    .into()
}

#[test]
fn foxglove_says_the_same_in_protobuf_and_json() {
    for (schema, protobuf, json) in fox_messages() {
        let reading = Decoder::of("protobuf", schema).unwrap().read(&protobuf).unwrap();
        assert_eq!(
            Decoder::of("json", schema).unwrap().read(&json).as_ref(),
            Ok(&reading),
            "{schema}"
        );
        match reading {
            Reading::Picture(picture) => {
                assert_eq!((picture.nanos, &*picture.frame_id), (NANOS, "camera"));
                match picture.content().unwrap() {
                    Content::Depth => assert_eq!(picture.depth().unwrap().bytes, depth_png()),
                    _ => assert_eq!(picture.color().unwrap().bytes, [3, 2, 1, 6, 5, 4]),
                }
            }
            Reading::Calibration(found) => {
                let found = found.of_pictures((640, 480), false).unwrap().camera;
                assert_eq!(found.intrinsics.fy, 510.0);
                assert_eq!(found.distortion, Distortion::BrownConrady(vec![0.1; 5]));
            }
            Reading::Transforms(all) => {
                assert_eq!((&*all[0].parent, &*all[0].child), ("world", "camera"));
                assert_eq!(all[0].parent_from_child.translation.y, 2.0);
            }
            Reading::Pose(posed) => {
                assert_eq!((posed.nanos, posed.pose.translation.y), (NANOS, 2.0))
            }
            Reading::Gravity(_) => panic!("{schema} is no IMU"),
        }
        // Negative control: one encoding is not the other.
        assert!(Decoder::of("json", schema).unwrap().read(&protobuf).is_err());
    }
}

/// Everything that can be asked of a reading; whether all of it could be answered.
fn is_usable(reading: &Reading) -> bool {
    match reading {
        Reading::Picture(picture) => {
            picture.size().is_ok() && (picture.color().is_ok() || picture.depth().is_ok())
        }
        Reading::Calibration(found) => found.of_pictures((640, 480), false).is_ok(),
        Reading::Transforms(_) | Reading::Pose(_) | Reading::Gravity(_) => true,
    }
}

#[test]
fn damaged_messages_are_read_or_refused() {
    let pose = ([1.0, 2.0, 3.0], QUARTER);
    let header = [0_u8; 12];
    let rvl =
        [&header[..], &2_u32.to_le_bytes(), &1_u32.to_le_bytes(), &[0, 0, 0xe1, 0x11]].concat();
    let region = Region::default();
    let ros_messages = [
        ("sensor_msgs/msg/Image", raw([2, 2], "bgr8", 6, false, &[5; 12])),
        ("sensor_msgs/msg/Image", raw([2, 2], "32FC1", 8, true, &[5; 16])),
        ("sensor_msgs/msg/CompressedImage", compressed("png", &depth_png())),
        ("sensor_msgs/msg/CompressedImage", compressed("16UC1; compressedDepth rvl", &rvl)),
        (
            "sensor_msgs/msg/CompressedImage",
            compressed("32FC1; compressedDepth", &[&header[..], &depth_png()].concat()),
        ),
        ("sensor_msgs/msg/CameraInfo", calibration_message("plumb_bob", &[0.1; 5], [2, 2], region)),
        ("tf2_msgs/msg/TFMessage", cdr((vec![(HEADER, "base", pose); 3],))),
        ("geometry_msgs/msg/PoseStamped", cdr((HEADER, pose))),
    ];
    let mut messages: Vec<_> =
        ros_messages.into_iter().map(|(schema, bytes)| (ros(schema), bytes)).collect();
    for (schema, protobuf, json) in fox_messages() {
        messages.push((Decoder::of("protobuf", schema).unwrap(), protobuf));
        messages.push((Decoder::of("json", schema).unwrap(), json));
    }
    let mut random = ChaCha8Rng::seed_from_u64(23);
    let (mut read, mut refused) = (0, 0);
    for number in 0..mutations(20_000) {
        let (decoder, whole) = &messages[number as usize % messages.len()];
        let mut bytes = whole.clone();
        mutate(&mut random, &mut bytes);
        match decoder.read(&bytes) {
            Ok(reading) if is_usable(&reading) => read += 1,
            _ => refused += 1,
        }
    }
    println!("{read} were read, {refused} were refused");
    assert!(read > 100 && refused > 100, "{read} {refused}");
    for (decoder, whole) in &messages[1..] {
        assert!(decoder.read(whole).is_ok(), "{decoder:?}");
    }
}
