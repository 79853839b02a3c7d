//! Each effect, measured on planes and steps beside the same with the effect off.

use super::clean::Clean;
use super::color;
use super::depth::{deviation, measured};
use super::motion::{Flow, Motion};
use super::noise::Noise;
use super::preset::{ColorPreset, D435, KINECT, PERFECT, PHONE, Preset, TOF};
use super::surface::cosines;
use super::{Sensed, mean_brightness};
use crate::camera::Camera;
use crate::dataset::{SyntheticDataset, Walk};
use lexsplat_client::dataset::{Dataset, DatasetError, Intrinsics, RgbdFrame, Truth};
use nalgebra::Vector3;
use std::sync::LazyLock;

const NOISE: Noise = Noise { seed: 3, frame: 8 };
const ALL: [Preset; 4] = [KINECT, D435, TOF, PHONE];
const WIDTH: usize = 320;
const HEIGHT: usize = 240;

fn camera() -> Intrinsics {
    let (width, height) = (WIDTH as u32, HEIGHT as u32);
    Intrinsics { width, height, fx: 280.0, fy: 280.0, cx: 159.5, cy: 119.5 }
}

/// A frame with this depth, and light of 0.5 everywhere.
fn frame(depth: impl Fn(usize, usize) -> f32) -> Clean {
    let pixels = 0..WIDTH * HEIGHT;
    let depth: Vec<f32> = pixels.map(|i| depth(i % WIDTH, i / WIDTH)).collect();
    Clean { camera: camera(), light: vec![[0.5; 3]; depth.len()], depth }
}

fn plane(z: f32) -> Clean {
    frame(|_, _| z)
}

/// The first column of the box in `step`: inside a cell of the phone's grid.
const EDGE: usize = 161;

/// A box at 1.5 m before a wall at 3 m.
fn step() -> Clean {
    frame(|x, _| if x < EDGE { 3.0 } else { 1.5 })
}

fn sensed(clean: &Clean, preset: &Preset) -> Vec<f32> {
    measured(clean, &Flow::of(clean, &Motion::STILL), preset, NOISE)
}

/// Standard deviation of what was measured, and the share that was.
fn spread(found: &[f32], truth: f32) -> (f32, f32) {
    let known: Vec<f32> = found.iter().copied().filter(|z| *z > 0.0).collect();
    let square = known.iter().map(|z| (z - truth).powi(2)).sum::<f32>() / known.len() as f32;
    (square.sqrt(), known.len() as f32 / found.len() as f32)
}

#[test]
fn noise_on_a_plane_is_that_of_the_model() {
    for preset in ALL {
        for z in [1.0, 2.0, 3.0] {
            let model = deviation(&preset.axial, z, 1.0, 0.5);
            let (found, share) = spread(&sensed(&plane(z), &preset), z);
            assert!((found / model - 1.0).abs() < 0.15, "{} at {z}: {found}, {model}", preset.name);
            assert!(share > 0.99, "{} at {z} m: {share}", preset.name);
        }
    }
    // The published figures themselves, metres.
    assert!((deviation(&KINECT.axial, 2.0, 1.0, 0.5) - 0.00606).abs() < 1e-4);
    assert!((deviation(&D435.axial, 2.0, 1.0, 0.5) - 0.0143).abs() < 1e-4);
    assert!(deviation(&TOF.axial, 3.5, 1.0, 0.5) < 0.017);
    // Without noise there is none.
    let (found, share) = spread(&sensed(&plane(2.0), &PERFECT), 2.0);
    assert!(found < 1e-6 && share == 1.0);
}

#[test]
fn noise_grows_with_the_angle_and_on_dark_surfaces() {
    let at =
        |preset: &Preset, cosine, brightness| deviation(&preset.axial, 2.0, cosine, brightness);
    assert!(at(&KINECT, 0.2, 0.5) > 1.1 * at(&KINECT, 1.0, 0.5));
    assert!(at(&KINECT, 1.0, 0.1) == at(&KINECT, 1.0, 0.5));
    assert!(at(&TOF, 1.0, 0.1) > 2.0 * at(&TOF, 1.0, 0.5));
    // The angle is measured: a wall turned by 60 degrees about the vertical.
    let (sine, cosine) = 60.0_f32.to_radians().sin_cos();
    let slope = |x: usize| 2.0 * cosine / (cosine - sine * (x as f32 - 159.5) / 280.0);
    let wall = frame(|x, _| slope(x));
    let middle = HEIGHT / 2 * WIDTH + WIDTH / 2;
    let found = cosines(&wall.camera, &wall.depth)[middle];
    assert!((found - 0.5).abs() < 0.01, "{found}");
    assert!((cosines(&wall.camera, &plane(2.0).depth)[middle] - 1.0).abs() < 0.01);
}

#[test]
fn values_are_steps_of_disparity_for_triangulating_sensors_only() {
    let values = |preset: &Preset| {
        let mut found: Vec<u32> =
            sensed(&plane(3.0), preset).iter().map(|z| (z * 1000.0).round() as u32).collect();
        found.sort_unstable();
        found.dedup();
        found
    };
    let kinect = values(&KINECT);
    // 0.00285 z² is 26 mm at 3 m.
    assert!(kinect.windows(2).all(|pair| pair[1] - pair[0] >= 22), "{kinect:?}");
    let smooth = values(&Preset { inverse_step: 0.0, ..KINECT });
    assert!(smooth.len() > 3 * kinect.len(), "{} and {}", smooth.len(), kinect.len());
    assert!(values(&TOF).windows(2).any(|pair| pair[1] - pair[0] == 1));
}

/// Number of pixels between both surfaces, near the edge and elsewhere.
fn between(preset: &Preset) -> [usize; 2] {
    let found = sensed(&step(), preset);
    let is_between = |z: f32| z > 1.8 && z < 2.6;
    let mut counts = [0; 2];
    for (i, _) in found.iter().enumerate().filter(|(_, z)| is_between(**z)) {
        counts[usize::from((i % WIDTH).abs_diff(EDGE) > 8)] += 1;
    }
    counts
}

#[test]
fn flying_pixels_are_at_edges_only() {
    for preset in [TOF, PHONE, D435] {
        let [edge, inside] = between(&preset);
        assert!(edge > HEIGHT / 10 && inside == 0, "{}: {edge}, {inside}", preset.name);
    }
    assert_eq!(between(&Preset { flying: 0.0, ..TOF }), [0, 0]);
    assert_eq!(between(&Preset { grid: None, ..PHONE }), [0, 0]);
}

#[test]
fn edges_are_ragged_by_lateral_noise() {
    // Pixels left of the edge that show the box, and pixels right of it that show the wall.
    let crossed = |preset: &Preset| {
        let found = sensed(&step(), preset);
        let wrong = |(i, z): (usize, &f32)| *z > 0.0 && (i % WIDTH < EDGE) == (*z < 2.2);
        found.iter().enumerate().filter(|pixel| wrong(*pixel)).count() as f32 / HEIGHT as f32
    };
    let only = Preset { lateral: 0.8, lateral_reach: 2.0, native_columns: 320, ..PERFECT };
    // A place d pixels from the edge crosses it with the probability of a shift beyond d: 0.27 on
    // each side for 0.5 pixels and 0.8 of deviation, 0.03 for 1.5 pixels.
    let found = crossed(&only);
    assert!((found - 0.6).abs() < 0.2, "{found}");
    assert_eq!(crossed(&Preset { lateral: 0.0, ..only }), 0.0);
}

#[test]
fn holes_are_in_shadows_on_dark_and_grazing_surfaces_and_out_of_range() {
    let share = |clean: &Clean, preset: &Preset| spread(&sensed(clean, preset), 0.0).1;
    // f b (1/1.5 - 1/3) = 280 x 0.075 / 3 = 7 columns of 320 on the left of the box.
    let shadow = Preset { baseline: 0.075, ..PERFECT };
    let hidden = 1.0 - share(&step(), &shadow);
    assert!((hidden * WIDTH as f32 - 7.0).abs() < 1.5, "{}", hidden * WIDTH as f32);
    let found = sensed(&step(), &shadow);
    assert!(found[..WIDTH].iter().position(|z| *z == 0.0).is_some_and(|x| (152..161).contains(&x)));
    assert_eq!(share(&step(), &PERFECT), 1.0);
    let dark = Clean { light: vec![[0.02; 3]; WIDTH * HEIGHT], ..plane(3.0) };
    assert!(share(&dark, &TOF) < 0.1 && share(&plane(3.0), &TOF) > 0.99);
    assert!(share(&dark, &PHONE) > 0.99, "a phone fills them");
    // A floor 1 m below the camera, seen at more than 84 degrees near the horizon.
    let floor = |y: usize| 280.0 / (y as f32 - 119.5);
    let grazing = frame(|_, y| if floor(y) > 0.0 && floor(y) < 20.0 { floor(y) } else { 2.0 });
    let endless = Preset { far: 100.0, axial: PERFECT.axial, ..KINECT };
    assert!(share(&grazing, &endless) < 0.95 * share(&grazing, &PERFECT));
    for preset in ALL {
        assert_eq!(share(&plane(preset.far * 1.3), &preset), 0.0, "{}", preset.name);
        assert_eq!(share(&plane(preset.near * 0.7), &preset), 0.0, "{}", preset.name);
    }
}

const PAN: Motion =
    Motion { linear: Vector3::new(0.0, 0.0, 0.0), angular: Vector3::new(0.0, 1.0, 0.0) };

#[test]
fn depth_lags_behind_color_by_the_motion_of_the_lag() {
    // A turn of 1 rad/s to the right moves the edge by 280 columns per second to the left.
    let edge = |lag: f64| {
        let clean = step();
        let preset = Preset { depth_lag: lag, ..PERFECT };
        let found = measured(&clean, &Flow::of(&clean, &PAN), &preset, NOISE);
        found[..WIDTH].iter().position(|z| *z < 2.0).unwrap()
    };
    assert_eq!((edge(0.0), edge(0.05), edge(-0.05)), (161, 147, 175));
}

/// A picture with a vertical edge: black on the left, grey on the right.
fn edge_picture() -> Clean {
    let light =
        (0..WIDTH * HEIGHT).map(|i| if i % WIDTH < WIDTH / 2 { [0.0; 3] } else { [0.5; 3] });
    Clean { light: light.collect(), ..plane(2.0) }
}

fn taken(clean: &Clean, motion: &Motion, preset: &ColorPreset, gain: f32) -> Vec<u8> {
    color::seen(clean, &Flow::of(clean, motion), preset, gain, NOISE)
}

#[test]
fn motion_blurs_and_a_rolling_shutter_slants() {
    let off = PERFECT.color;
    let row = |bytes: &[u8], y: usize| -> Vec<u8> {
        bytes[3 * y * WIDTH..][..3 * WIDTH].iter().step_by(3).copied().collect()
    };
    // Columns that are neither black nor grey.
    let soft = |bytes: &[u8]| row(bytes, 120).iter().filter(|v| **v > 5 && **v < 180).count();
    let blur = ColorPreset { exposure: 0.03, ..off };
    let clean = edge_picture();
    let blurred = soft(&taken(&clean, &PAN, &blur, 1.0));
    assert!((6..=10).contains(&blurred), "{blurred} for 0.03 s x 280 columns/s");
    assert_eq!(soft(&taken(&clean, &Motion::STILL, &blur, 1.0)), 0);
    assert_eq!(soft(&taken(&clean, &PAN, &off, 1.0)), 0);
    let rolling = ColorPreset { readout: 0.03, ..off };
    let edge = |bytes: &[u8], y| row(bytes, y).iter().position(|v| *v > 90).unwrap() as i32;
    let slant = |preset: &ColorPreset| {
        let bytes = taken(&clean, &PAN, preset, 1.0);
        edge(&bytes, HEIGHT - 1) - edge(&bytes, 0)
    };
    assert!((slant(&rolling) + 8).abs() <= 1, "{}", slant(&rolling));
    assert_eq!(slant(&off), 0);
}

#[test]
fn noise_vignetting_gain_and_clipping_of_color() {
    let (off, clean) = (PERFECT.color, plane(2.0));
    let light = |byte: u8| (f32::from(byte) / 255.0 + 0.055).powf(2.4) / 1.055_f32.powf(2.4);
    let plain = taken(&clean, &Motion::STILL, &off, 1.0);
    assert!(plain.iter().all(|v| *v == 188), "light of 0.5 is 188 in sRGB");
    // Shot noise of 0.5 x 1000 electrons: 0.5 / sqrt(500) of light, 0.0224.
    let noisy = ColorPreset { white_electrons: 1000.0, ..off };
    let found: Vec<f32> =
        taken(&clean, &Motion::STILL, &noisy, 1.0).iter().map(|v| light(*v)).collect();
    let (deviation, _) = spread(&found, 0.5);
    assert!((deviation / 0.0224 - 1.0).abs() < 0.1, "{deviation}");
    let dark_corners = ColorPreset { vignetting: 0.2, ..off };
    let shaded = taken(&clean, &Motion::STILL, &dark_corners, 1.0);
    let middle = 3 * (HEIGHT / 2 * WIDTH + WIDTH / 2);
    assert!((light(shaded[0]) - 0.4).abs() < 0.01 && shaded[middle] == 188);
    let bright = taken(&clean, &Motion::STILL, &off, 2.5);
    assert!(bright.iter().all(|v| *v == 255), "clipped");
}

/// A small room, lit once for all tests.
static ROOM: LazyLock<SyntheticDataset> = LazyLock::new(|| {
    SyntheticDataset::of(&Walk { frames: 40, camera: Camera::new(80, 60), ..Walk::new(4) })
});

struct Shared;

impl Dataset for Shared {
    fn name(&self) -> &str {
        ROOM.name()
    }
    fn len(&self) -> usize {
        ROOM.len()
    }
    fn intrinsics(&self) -> Intrinsics {
        ROOM.intrinsics()
    }
    fn depth_unit_metres(&self) -> f64 {
        ROOM.depth_unit_metres()
    }
    fn sequence(&self, index: usize) -> u64 {
        ROOM.sequence(index)
    }
    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        ROOM.frame(index)
    }
    fn truth(&self) -> Option<&dyn Truth> {
        ROOM.truth()
    }
}

fn room(preset: Preset, seed: u64) -> Sensed {
    Sensed::new(Box::new(Shared), preset, seed, 2)
}

#[test]
fn frames_repeat_and_poses_and_truth_stay() {
    for preset in ALL {
        let (one, other) = (room(preset, 1), room(preset, 1));
        // Another order of reading changes nothing.
        one.frame(5).unwrap();
        let frame = one.frame(7).unwrap();
        assert_eq!(frame, other.frame(7).unwrap());
        let clean = one.clean_frame(7).unwrap();
        assert_ne!((&frame.color, &frame.depth), (&clean.color, &clean.depth));
        assert_eq!(frame.world_from_camera, clean.world_from_camera);
        assert_eq!(
            (frame.sequence, frame.timestamp_nanos),
            (clean.sequence, clean.timestamp_nanos)
        );
        let mask = |dataset: &Sensed| dataset.truth().unwrap().mask(7).unwrap();
        assert_eq!(mask(&one).ids, mask(&room(PERFECT, 1)).ids);
        assert_ne!(room(preset, 2).frame(7).unwrap().depth, frame.depth, "another seed");
    }
}

#[test]
fn a_perfect_sensor_changes_depth_by_less_than_a_millimetre() {
    let room = room(PERFECT, 1);
    let decoded = |frame| Clean::of(&frame, room.intrinsics(), room.depth_unit_metres()).unwrap();
    let (found, clean) = (decoded(room.frame(3).unwrap()), decoded(room.clean_frame(3).unwrap()));
    let differ = |(a, b): (&f32, &f32)| (a - b).abs();
    let worst = found.depth.iter().zip(&clean.depth).map(differ).fold(0.0, f32::max);
    assert!(worst < 0.00061, "{worst}");
}

#[test]
fn exposure_starts_at_1_and_evens_out_brightness_slowly() {
    let room =
        room(Preset { color: ColorPreset { auto_exposure: 1.0, ..PERFECT.color }, ..PERFECT }, 1);
    let gains: Vec<f32> = (0..40).map(|i| room.gain(i).unwrap()).collect();
    assert_eq!(gains[2], 1.0);
    let change = |pair: &[f32]| (pair[1] / pair[0] - 1.0).abs();
    assert!(gains.windows(2).all(|pair| change(pair) < 0.1), "{gains:?}");
    assert!(gains.iter().any(|gain| (gain - 1.0).abs() > 0.02), "{gains:?}");
    let brightness = |frame| mean_brightness(&frame, &room.intrinsics()).unwrap();
    let worst = |exposed: bool| {
        let one = |i| if exposed { room.frame(i) } else { room.clean_frame(i) };
        let first = brightness(one(2).unwrap());
        (10..40)
            .step_by(5)
            .map(|i| (brightness(one(i).unwrap()) / first).ln().abs())
            .fold(0.0, f32::max)
    };
    assert!(worst(true) < worst(false), "{} and {}", worst(true), worst(false));
    assert_eq!(Sensed { preset: PERFECT, ..room }.gain(30).unwrap(), 1.0);
}
