//! Every check of frames and opening messages: each test changes one field of a frame that passes.

mod cameras;
mod labels;
mod mutations;

use super::*;
use crate::pipeline::frame::Frame;
use crate::pipeline::registration::RawFrame;
use image::{ColorType, ExtendedColorType, ImageEncoder as _};
use lexsplat_proto::v1::{self, ColorFormat, DepthFormat};

const WIDTH: u32 = 32;
const HEIGHT: u32 = 24;
const PIXELS: usize = (WIDTH * HEIGHT) as usize;
const LIMITS: Limits = Limits {
    max_pixels: 16 << 20,
    max_sequence_step: 1_000_000,
    min_depth_metres: 0.01,
    max_depth_metres: 100.0,
};

fn open_message() -> v1::OpenMap {
    v1::OpenMap {
        map: "kitchen".into(),
        intrinsics: Some(v1::Intrinsics {
            width: WIDTH,
            height: HEIGHT,
            fx: 30.0,
            fy: 30.0,
            cx: 15.5,
            cy: 11.5,
        }),
        depth_unit_metres: 0.001,
        pose_source: v1::PoseSource::Given.into(),
        label_texts: ["wall", " sofa\n", ""].map(str::to_owned).to_vec(),
        ..v1::OpenMap::default()
    }
}

fn opened() -> Opening {
    opening(&open_message(), &LIMITS).unwrap()
}

fn rgb() -> Vec<u8> {
    (0..PIXELS * 3).map(|at| (at * 7 % 251) as u8).collect()
}

fn millimetres() -> Vec<u16> {
    (0..PIXELS).map(|at| 1000 + at as u16).collect()
}

fn u16_bytes(units: &[u16]) -> Vec<u8> {
    units.iter().flat_map(|units| units.to_le_bytes()).collect()
}

fn png(data: &[u8], width: u32, height: u32, color: ExtendedColorType) -> Vec<u8> {
    let mut out = Vec::new();
    image::codecs::png::PngEncoder::new(&mut out).write_image(data, width, height, color).unwrap();
    out
}

fn jpeg(data: &[u8], width: u32, height: u32) -> Vec<u8> {
    let mut out = Vec::new();
    image::codecs::jpeg::JpegEncoder::new(&mut out)
        .write_image(data, width, height, ExtendedColorType::Rgb8)
        .unwrap();
    out
}

fn good() -> v1::Frame {
    v1::Frame {
        sequence: 5,
        timestamp_nanos: 17,
        color_format: ColorFormat::Rgb8.into(),
        color: rgb().into(),
        depth_format: DepthFormat::U16.into(),
        depth: u16_bytes(&millimetres()).into(),
        world_from_camera: Some(v1::Pose {
            rotation: Some(v1::Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 }),
            translation_metres: Some(v1::Vector3 { x: 1.0, y: 2.0, z: 3.0 }),
        }),
        ..v1::Frame::default()
    }
}

fn check(wire: &v1::Frame) -> Result<Frame, Refusal> {
    frame(wire, &opened(), Some(4), &LIMITS).map(|RawFrame(frame)| frame)
}

fn refused(change: impl FnOnce(&mut v1::Frame)) -> (String, String) {
    let mut wire = good();
    check(&wire).expect("the twin passes");
    change(&mut wire);
    let refusal = check(&wire).expect_err("it is refused");
    (refusal.field, refusal.reason)
}

fn with_color(format: ColorFormat, color: Vec<u8>) -> v1::Frame {
    v1::Frame { color_format: format.into(), color: color.into(), ..good() }
}

fn with_depth(format: DepthFormat, depth: Vec<u8>) -> v1::Frame {
    v1::Frame { depth_format: format.into(), depth: depth.into(), ..good() }
}

#[test]
fn a_good_frame_passes_unchanged() {
    let frame = check(&good()).unwrap();
    assert_eq!((frame.sequence, frame.timestamp_nanos), (5, 17));
    assert_eq!(&*frame.rgb, rgb());
    assert!((frame.depth_metres[10] - 1.010).abs() < 1e-6);
    assert_eq!(frame.world_from_camera.unwrap().translation.y, 2.0);
}

#[test]
fn every_format_gives_the_same_frame() {
    let expected = check(&good()).unwrap();
    let coded =
        check(&with_color(ColorFormat::Png, png(&rgb(), WIDTH, HEIGHT, ExtendedColorType::Rgb8)));
    assert_eq!(coded.unwrap().rgb, expected.rgb);
    let units = millimetres();
    // The encoder takes native-endian samples.
    let native: Vec<u8> = units.iter().flat_map(|units| units.to_ne_bytes()).collect();
    let forms = [
        (DepthFormat::Png16, png(&native, WIDTH, HEIGHT, ExtendedColorType::L16)),
        (DepthFormat::U16Zstd, zstd::encode_all(&u16_bytes(&units)[..], 1).unwrap()),
        (
            DepthFormat::F32Metres,
            units.iter().flat_map(|units| (f32::from(*units) * 0.001).to_le_bytes()).collect(),
        ),
    ];
    for (format, data) in forms {
        let frame = check(&with_depth(format, data)).unwrap();
        let worst = frame
            .depth_metres
            .iter()
            .zip(expected.depth_metres.iter())
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        assert!(worst < 1e-6, "{format:?}: {worst}");
    }
}

#[test]
fn jpeg_whole_passes_and_cut_is_refused() {
    let smooth: Vec<u8> = (0..PIXELS).flat_map(|at| [(at / WIDTH as usize * 8) as u8; 3]).collect();
    let whole = jpeg(&smooth, WIDTH, HEIGHT);
    let frame = check(&with_color(ColorFormat::Jpeg, whole.clone())).unwrap();
    let worst = frame.rgb.iter().zip(&smooth).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
    assert!(worst < 16, "{worst}");
    let padded = [whole.clone(), vec![0; 7]].concat();
    check(&with_color(ColorFormat::Jpeg, padded)).unwrap();
    for keep in [0, 1, 2, whole.len() / 2, whole.len() - 1] {
        let refusal = check(&with_color(ColorFormat::Jpeg, whole[..keep].to_vec())).unwrap_err();
        assert_eq!(refusal.field, "color", "{keep}");
    }
}

#[test]
fn png_cut_is_refused() {
    let whole = png(&rgb(), WIDTH, HEIGHT, ExtendedColorType::Rgb8);
    check(&with_color(ColorFormat::Png, whole.clone())).unwrap();
    for keep in [0, 10, whole.len() / 2] {
        let refusal = check(&with_color(ColorFormat::Png, whole[..keep].to_vec())).unwrap_err();
        assert_eq!(refusal.field, "color", "{keep}");
    }
}

#[test]
fn sizes_that_disagree_are_refused() {
    let wide = rgb()[..(WIDTH as usize / 2 * HEIGHT as usize * 3)].to_vec();
    let small = jpeg(&wide, WIDTH / 2, HEIGHT);
    let (field, reason) = refused(|wire| {
        wire.color_format = ColorFormat::Jpeg.into();
        wire.color = small.into();
    });
    assert_eq!(field, "color");
    assert!(reason.contains("expected 32x24") && reason.contains("found 16x24"), "{reason}");
    assert_eq!(refused(|wire| wire.color = vec![0; 5].into()).0, "color");
    assert_eq!(refused(|wire| wire.depth = vec![1; PIXELS * 2 - 2].into()).0, "depth");
    assert_eq!(refused(|wire| wire.depth = vec![1; PIXELS * 4].into()).0, "depth");
    assert_eq!(refused(|wire| wire.depth_format = DepthFormat::F32Metres.into()).0, "depth");
}

/// A PNG header that claims 10,000 x 10,000 pixels, with nothing behind it.
fn huge_png() -> Vec<u8> {
    let small = png(&[0; 12], 2, 2, ExtendedColorType::Rgb8);
    let mut header = small[..33].to_vec();
    header[16..20].copy_from_slice(&10_000_u32.to_be_bytes());
    header[20..24].copy_from_slice(&10_000_u32.to_be_bytes());
    let crc = crc32(&header[12..29]);
    header[29..33].copy_from_slice(&crc.to_be_bytes());
    [header, small[33..].to_vec()].concat()
}

fn crc32(data: &[u8]) -> u32 {
    !data.iter().fold(!0_u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg())
        })
    })
}

#[test]
fn a_huge_image_is_refused_by_its_header() {
    let (field, reason) = refused(|wire| {
        wire.color_format = ColorFormat::Png.into();
        wire.color = huge_png().into();
    });
    assert_eq!(field, "color");
    assert!(reason.contains("found 10000x10000"), "{reason}");
}

#[test]
fn openings_are_checked() {
    opened();
    let field = |change: fn(&mut v1::OpenMap)| {
        let mut open = open_message();
        change(&mut open);
        match opening(&open, &LIMITS) {
            Err(refusal) => refusal.field,
            other => panic!("{other:?}"),
        }
    };
    fn camera(open: &mut v1::OpenMap) -> &mut v1::Intrinsics {
        open.intrinsics.as_mut().unwrap()
    }
    assert_eq!(field(|open| open.intrinsics = None), "intrinsics");
    assert_eq!(field(|open| camera(open).width = 0), "intrinsics.width");
    assert_eq!(field(|open| camera(open).fx = f64::NAN), "intrinsics.fx");
    assert_eq!(
        field(|open| (camera(open).width, camera(open).height) = (10_000, 10_000)),
        "intrinsics.width"
    );
    for unit in [-0.001, f64::NAN, 1000.0] {
        let mut open = open_message();
        open.depth_unit_metres = unit;
        assert!(opening(&open, &LIMITS).unwrap_err().to_string().contains("depth_unit_metres"));
    }
    assert_eq!(field(|open| open.pose_source = 9), "pose_source");
    let mut open = open_message();
    open.pose_source = v1::PoseSource::Estimated.into();
    assert!(opening(&open, &LIMITS).unwrap().estimates_poses);
    assert!(!opening(&open_message(), &LIMITS).unwrap().estimates_poses);
}

#[test]
fn poses_are_checked() {
    fn rotation(wire: &mut v1::Frame) -> &mut v1::Quaternion {
        wire.world_from_camera.as_mut().unwrap().rotation.as_mut().unwrap()
    }
    fn translation(wire: &mut v1::Frame) -> &mut v1::Vector3 {
        wire.world_from_camera.as_mut().unwrap().translation_metres.as_mut().unwrap()
    }
    assert_eq!(refused(|wire| wire.world_from_camera = None).0, "world_from_camera");
    assert_eq!(refused(|wire| rotation(wire).w = 0.5).0, "world_from_camera.rotation");
    assert_eq!(refused(|wire| rotation(wire).x = f64::NAN).0, "world_from_camera.rotation");
    assert_eq!(
        refused(|wire| translation(wire).z = f64::INFINITY).0,
        "world_from_camera.translation_metres"
    );
    assert_eq!(
        refused(|wire| wire.world_from_camera.as_mut().unwrap().rotation = None).0,
        "world_from_camera.rotation"
    );
}

#[test]
fn covariances_are_checked() {
    let identity: Vec<f64> = (0..36).map(|at| f64::from(u8::from(at % 7 == 0))).collect();
    check(&v1::Frame { pose_covariance: identity.clone(), ..good() }).unwrap();
    let field = |covariance: Vec<f64>| refused(|wire| wire.pose_covariance = covariance).0;
    let changed = |at: usize, to: f64| {
        let mut numbers = identity.clone();
        numbers[at] = to;
        numbers
    };
    assert_eq!(field(vec![1.0; 6]), "pose_covariance");
    assert_eq!(field(changed(0, -1.0)), "pose_covariance");
    assert_eq!(field(changed(1, 0.5)), "pose_covariance");
    assert_eq!(field(changed(35, f64::NAN)), "pose_covariance");
}

#[test]
fn sequences_increase() {
    assert_eq!(refused(|wire| wire.sequence = 4).0, "sequence");
    assert_eq!(refused(|wire| wire.sequence = 0).0, "sequence");
    let first = v1::Frame { sequence: 0, ..good() };
    frame(&first, &opened(), None, &LIMITS).unwrap();
}

#[test]
fn a_sequence_number_leaves_room_for_the_next() {
    let after = |newest: Option<u64>, sequence: u64| {
        let found = frame(&v1::Frame { sequence, ..good() }, &opened(), newest, &LIMITS);
        found.map(|_| ()).map_err(|refusal| refusal.field)
    };
    let refused = Err("sequence".to_owned());
    assert_eq!(after(None, u64::MAX), refused);
    assert_eq!(after(Some(5), u64::MAX), refused);
    assert_eq!(after(Some(5), 1_000_006), refused);
    assert_eq!(after(Some(5), 1_000_005), Ok(()));
    assert_eq!(after(None, 1_700_000_000_000_000_000), Ok(()), "nanoseconds since 1970");
    assert_eq!(after(Some(u64::MAX - 1), u64::MAX), Ok(()));
}

#[test]
fn unknown_formats_are_refused() {
    for format in [0, 77] {
        assert_eq!(refused(|wire| wire.color_format = format).0, "color_format");
        assert_eq!(refused(|wire| wire.depth_format = format).0, "depth_format");
    }
    let eight_bit = png(&vec![100; PIXELS], WIDTH, HEIGHT, ColorType::L8.into());
    let refusal = check(&with_depth(DepthFormat::Png16, eight_bit)).unwrap_err();
    assert!(refusal.reason.contains("16-bit grey"), "{refusal}");
}

#[test]
fn a_wrong_depth_unit_is_refused_with_a_hint() {
    let with_unit = |unit| {
        let open = v1::OpenMap { depth_unit_metres: unit, ..open_message() };
        frame(&good(), &opening(&open, &LIMITS).unwrap(), None, &LIMITS)
    };
    with_unit(0.001).unwrap();
    for unit in [1.0, 1e-6] {
        let refusal = with_unit(unit).unwrap_err();
        assert_eq!(refusal.field, "depth");
        assert!(refusal.reason.contains("is depth_unit_metres right?"), "{refusal}");
    }
    assert_eq!(with_unit(0.0).unwrap_err().field, "depth_format");
}

#[test]
fn bad_single_depths_are_no_measurement() {
    let mut metres = vec![2.0_f32; PIXELS];
    metres[..5].copy_from_slice(&[f32::NAN, f32::INFINITY, -1.0, 1e9, 0.001]);
    let data = metres.iter().flat_map(|metres| metres.to_le_bytes()).collect();
    let frame = check(&with_depth(DepthFormat::F32Metres, data)).unwrap();
    assert_eq!(frame.depth_metres[..6], [0.0, 0.0, 0.0, 0.0, 0.0, 2.0]);
    let blind = check(&with_depth(DepthFormat::U16, vec![0; PIXELS * 2])).unwrap();
    assert!(blind.depth_metres.iter().all(|metres| *metres == 0.0));
}

#[test]
fn a_saturated_depth_is_no_measurement_in_each_16_bit_format() {
    let mut units = vec![2000_u16; PIXELS];
    units[..3].copy_from_slice(&[u16::MAX, u16::MAX - 1, 0]);
    let native: Vec<u8> = units.iter().flat_map(|units| units.to_ne_bytes()).collect();
    let open = v1::OpenMap { depth_unit_metres: 1e-4, ..open_message() };
    let opening = opening(&open, &LIMITS).unwrap();
    for (format, data) in [
        (DepthFormat::Png16, png(&native, WIDTH, HEIGHT, ExtendedColorType::L16)),
        (DepthFormat::U16, u16_bytes(&units)),
        (DepthFormat::U16Zstd, zstd::encode_all(&u16_bytes(&units)[..], 1).unwrap()),
    ] {
        let RawFrame(found) = frame(&with_depth(format, data), &opening, None, &LIMITS).unwrap();
        // Negative control: one unit less is a depth like any other.
        let expected = [0.0, 6.5534, 0.0, 0.2];
        for (found, expected) in found.depth_metres.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{format:?}: {found}, not {expected}");
        }
    }
}

#[test]
fn a_zstd_bomb_is_refused() {
    let bomb = zstd::encode_all(&vec![0_u8; 64 << 20][..], 19).unwrap();
    assert!(bomb.len() < PIXELS * 16, "it is small on the wire");
    let refusal = check(&with_depth(DepthFormat::U16Zstd, bomb)).unwrap_err();
    assert!(refusal.reason.contains("more than"), "{refusal}");
    let refusal = check(&with_depth(DepthFormat::U16Zstd, vec![1, 2, 3])).unwrap_err();
    assert!(refusal.reason.contains("not zstd"), "{refusal}");
    let short = zstd::encode_all(&vec![1_u8; PIXELS][..], 1).unwrap();
    assert_eq!(check(&with_depth(DepthFormat::U16Zstd, short)).unwrap_err().field, "depth");
}
