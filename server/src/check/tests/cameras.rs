//! Checks of lenses, depth cameras, ranges, and frames with intrinsics of their own.

use super::*;

type Change = fn(&mut v1::OpenMap);

fn opened_with(change: Change) -> Result<Opening, Refusal> {
    let mut open = open_message();
    change(&mut open);
    opening(&open, &LIMITS)
}

fn lens(model: v1::DistortionModel, coefficients: &[f64]) -> Option<v1::Distortion> {
    Some(v1::Distortion { model: model.into(), coefficients: coefficients.to_vec() })
}

const BROWN: v1::DistortionModel = v1::DistortionModel::BrownConrady;
const FISHEYE: v1::DistortionModel = v1::DistortionModel::KannalaBrandt;
const DEPTH: v1::Intrinsics =
    v1::Intrinsics { width: 16, height: 12, fx: 15.0, fy: 15.0, cx: 7.5, cy: 5.5 };

fn depth(change: impl FnOnce(&mut v1::DepthCamera)) -> Option<v1::DepthCamera> {
    let mut camera = v1::DepthCamera { intrinsics: Some(DEPTH), ..v1::DepthCamera::default() };
    change(&mut camera);
    Some(camera)
}

fn pose(x: f64, w: f64) -> Option<v1::Pose> {
    Some(v1::Pose {
        rotation: Some(v1::Quaternion { w, ..v1::Quaternion::default() }),
        translation_metres: Some(v1::Vector3 { x, y: 0.0, z: 0.0 }),
    })
}

#[test]
fn usual_cameras_are_accepted() {
    let good: [Change; 8] = [
        |open| open.distortion = lens(BROWN, &[0.1, -0.2, 0.001, 0.001]),
        |open| open.distortion = lens(BROWN, &[0.1, -0.2, 0.001, 0.001, 0.05]),
        |open| open.distortion = lens(BROWN, &[0.5, -2.6, 0.0007, -0.0002, 1.5, 0.4, -2.5, 1.4]),
        |open| {
            let mut fourteen = [0.0; 14];
            fourteen[0] = 0.1;
            open.distortion = lens(BROWN, &fourteen);
        },
        |open| open.distortion = lens(FISHEYE, &[0.05, -0.01, 0.003, -0.001]),
        |open| open.depth_camera = depth(|_| {}),
        |open| open.depth_camera = depth(|camera| camera.color_from_depth = pose(-0.05, 1.0)),
        |open| {
            open.depth_camera = depth(|camera| {
                camera.intrinsics =
                    Some(v1::Intrinsics { width: 16, height: 12, ..v1::Intrinsics::default() });
            });
        },
    ];
    for (at, change) in good.into_iter().enumerate() {
        opened_with(change).unwrap_or_else(|refusal| panic!("{at}: {refusal}"));
    }
    let straight = opened_with(|_| {}).unwrap().registration.camera();
    assert_eq!(straight, opened().registration.cameras().color.intrinsics);
}

#[test]
fn absurd_cameras_name_the_field() {
    let bad: [(&str, Change); 18] = [
        ("distortion", |open| open.distortion = lens(BROWN, &[1e300, 0.0, 0.0, 0.0])),
        ("depth_camera.distortion", |open| {
            open.depth_camera = depth(|c| c.distortion = lens(FISHEYE, &[1e9, 0.0, 0.0, 0.0]));
        }),
        ("distortion.coefficients", |open| open.distortion = lens(BROWN, &[0.1; 3])),
        ("distortion.coefficients", |open| open.distortion = lens(BROWN, &[0.1; 14])),
        ("distortion.coefficients", |open| open.distortion = lens(BROWN, &[f64::NAN; 4])),
        ("distortion.coefficients", |open| open.distortion = lens(FISHEYE, &[0.1; 5])),
        ("distortion.model", |open| {
            open.distortion = lens(v1::DistortionModel::Unspecified, &[0.1; 4]);
        }),
        ("distortion.model", |open| {
            open.distortion = Some(v1::Distortion { model: 9, coefficients: vec![0.1; 4] });
        }),
        ("distortion", |open| {
            open.intrinsics.as_mut().unwrap().cx = -20.0;
            open.distortion = lens(BROWN, &[0.1; 4]);
        }),
        ("depth_camera.intrinsics", |open| open.depth_camera = depth(|c| c.intrinsics = None)),
        ("depth_camera.intrinsics.fx", |open| {
            open.depth_camera = depth(|c| c.intrinsics.as_mut().unwrap().fx = -1.0);
        }),
        ("depth_camera.intrinsics.width", |open| {
            open.depth_camera = depth(|c| c.intrinsics.as_mut().unwrap().width = 0);
        }),
        ("depth_camera.intrinsics", |open| {
            open.depth_camera = depth(|c| {
                c.intrinsics = Some(v1::Intrinsics { width: 16, height: 12, ..Default::default() });
                c.color_from_depth = pose(0.05, 1.0);
            });
        }),
        ("depth_camera.color_from_depth.rotation", |open| {
            open.depth_camera = depth(|c| c.color_from_depth = pose(0.05, 2.0));
        }),
        ("depth_camera.color_from_depth.translation_metres", |open| {
            open.depth_camera = depth(|c| c.color_from_depth = pose(50.0, 1.0));
        }),
        ("min_depth_metres", |open| open.min_depth_metres = -1.0),
        ("max_depth_metres", |open| {
            (open.min_depth_metres, open.max_depth_metres) = (3.0, 2.0);
        }),
        ("no_depth", |open| open.no_depth = vec![65_536]),
    ];
    for (field, change) in bad {
        let refusal = opened_with(change).unwrap_err();
        assert_eq!(refusal.field, field, "{refusal}");
    }
}

#[test]
fn range_and_values_of_no_depth_are_the_sender_s() {
    let opening = opened_with(|open| {
        (open.min_depth_metres, open.max_depth_metres) = (1.0, 3.0);
        open.no_depth = vec![2000];
    })
    .unwrap();
    let mut units = vec![1500_u16; PIXELS];
    units[..5].copy_from_slice(&[999, 1001, 2000, 3001, 0]);
    let wire = with_depth(DepthFormat::U16, u16_bytes(&units));
    let RawFrame(found) = frame(&wire, &opening, None, &LIMITS).unwrap();
    let expected = [0.0, 1.001, 0.0, 0.0, 0.0, 1.5];
    for (found, expected) in found.depth_metres.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6, "{found}, not {expected}");
    }
    // Negative control: with the usual settings these are depths like any other.
    let RawFrame(found) = frame(&wire, &opened(), None, &LIMITS).unwrap();
    assert!(
        found.depth_metres[..4].iter().all(|depth| *depth > 0.0),
        "{:?}",
        &found.depth_metres[..4]
    );
}

#[test]
fn depth_has_the_size_of_its_own_camera() {
    let opening = opened_with(|open| open.depth_camera = depth(|_| {})).unwrap();
    let units = vec![2000_u16; 16 * 12];
    let wire = with_depth(DepthFormat::U16, u16_bytes(&units));
    let raw = frame(&wire, &opening, None, &LIMITS).unwrap();
    let registered = registered(raw, &opening).unwrap();
    assert_eq!(registered.depth_metres.len(), PIXELS);
    let middle = registered.depth_metres[PIXELS / 2 + WIDTH as usize / 2];
    assert!((middle - 2.0).abs() < 1e-3, "{middle}");
    let refusal = frame(&good(), &opening, None, &LIMITS).unwrap_err();
    assert_eq!(refusal.field, "depth");
}

#[test]
fn a_frame_may_have_a_camera_of_its_own() {
    let own = |intrinsics| {
        let wire = v1::Frame { intrinsics: Some(intrinsics), ..good() };
        frame(&wire, &opened(), None, &LIMITS)
    };
    let usual = open_message().intrinsics.unwrap();
    let RawFrame(found) = own(v1::Intrinsics { fx: 31.0, ..usual }).unwrap();
    assert!((found.intrinsics.fx - 31.0).abs() < 1e-12);
    let refusal = own(v1::Intrinsics { width: WIDTH + 1, ..usual }).unwrap_err();
    assert_eq!(refusal.field, "intrinsics.width");
    assert_eq!(own(v1::Intrinsics { fx: 0.0, ..usual }).unwrap_err().field, "intrinsics.fx");
}

#[test]
fn depth_through_color_s_lens_has_color_s_shape() {
    let sized = |width, height| {
        let intrinsics = Some(v1::Intrinsics { width, height, ..v1::Intrinsics::default() });
        let depth_camera = Some(v1::DepthCamera { intrinsics, ..v1::DepthCamera::default() });
        opening(&v1::OpenMap { depth_camera, ..open_message() }, &LIMITS)
    };
    let (width, height) = (WIDTH, PIXELS as u32 / WIDTH);
    assert!(sized(width / 2, height / 2).is_ok());
    let refusal = sized(height / 2, width / 2).unwrap_err();
    assert_eq!(refusal.field, "depth_camera.intrinsics");
    assert!(refusal.reason.contains("90 degrees"), "{refusal}");
}

/// A line of depth gives few pixels of color their depth, and is taken all the same.
#[test]
fn a_line_scanner_is_taken() {
    let camera = depth(|camera| {
        let all = camera.intrinsics.unwrap();
        camera.intrinsics = Some(v1::Intrinsics { height: 1, cy: 0.0, ..all });
    });
    let opening =
        opening(&v1::OpenMap { depth_camera: camera, ..open_message() }, &LIMITS).unwrap();
    let wire = with_depth(DepthFormat::U16, u16_bytes(&[2000_u16; 16]));
    let seen = registered(frame(&wire, &opening, None, &LIMITS).unwrap(), &opening).unwrap();
    assert!(seen.depth_metres.iter().any(|depth| *depth > 0.0));
}

#[test]
fn depth_that_does_not_reach_the_picture_is_refused() {
    let wire = with_depth(DepthFormat::U16, u16_bytes(&[2000_u16; 16 * 12]));
    let registered_at = |x: f64| {
        let camera = depth(|camera| camera.color_from_depth = pose(x, 1.0));
        let open = v1::OpenMap { depth_camera: camera, ..open_message() };
        let opening = opening(&open, &LIMITS).unwrap();
        registered(frame(&wire, &opening, None, &LIMITS).unwrap(), &opening)
    };
    let beside = registered_at(0.05).unwrap();
    assert!(beside.depth_metres.iter().any(|depth| *depth > 0.0));
    let refusal = registered_at(5.0).unwrap_err();
    assert_eq!(refusal.field, "depth");
    assert!(refusal.reason.contains("color_from_depth"), "{refusal}");
}
