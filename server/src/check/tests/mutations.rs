//! Frames whose messages and images were damaged at random: each passes or is refused, and nothing panics.

use super::*;
use crate::test_support::{mutate, mutations};
use prost::Message as _;
use rand::Rng as _;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;

/// A frame of each pair of formats, with labels and a covariance.
fn seeds() -> Vec<v1::Frame> {
    let native: Vec<u8> = millimetres().iter().flat_map(|units| units.to_ne_bytes()).collect();
    let colors = [
        (ColorFormat::Rgb8, rgb()),
        (ColorFormat::Png, png(&rgb(), WIDTH, HEIGHT, ExtendedColorType::Rgb8)),
        (ColorFormat::Jpeg, jpeg(&rgb(), WIDTH, HEIGHT)),
    ];
    let depths = [
        (DepthFormat::U16, u16_bytes(&millimetres())),
        (DepthFormat::Png16, png(&native, WIDTH, HEIGHT, ExtendedColorType::L16)),
        (DepthFormat::U16Zstd, zstd::encode_all(&u16_bytes(&millimetres())[..], 1).unwrap()),
        (DepthFormat::F32Metres, 2.0_f32.to_le_bytes().repeat(PIXELS)),
    ];
    let labels = png(&vec![1; PIXELS], WIDTH, HEIGHT, ExtendedColorType::L8);
    let covariance: Vec<f64> = (0..36).map(|at| f64::from(u8::from(at % 7 == 0))).collect();
    let mut seeds = Vec::new();
    for (color_format, color) in &colors {
        for (depth_format, depth) in &depths {
            seeds.push(v1::Frame {
                color_format: (*color_format).into(),
                color: color.clone().into(),
                depth_format: (*depth_format).into(),
                depth: depth.clone().into(),
                label_format: v1::LabelFormat::Png.into(),
                labels: labels.clone().into(),
                pose_covariance: covariance.clone(),
                ..good()
            });
        }
    }
    seeds
}

#[test]
fn damaged_frames_pass_or_are_refused() {
    let seeds = seeds();
    assert!(seeds.iter().all(|seed| check(seed).is_ok()), "they pass");
    let mut random = ChaCha8Rng::seed_from_u64(22);
    let (mut passed, mut refused, mut unreadable) = (0, 0, 0);
    for number in 0..mutations(3000) {
        let mut wire = seeds[number as usize % seeds.len()].clone();
        let damaged = |random: &mut ChaCha8Rng, image: &prost::bytes::Bytes| {
            let mut bytes = image.to_vec();
            mutate(random, &mut bytes);
            bytes.into()
        };
        match random.random_range(0..4) {
            0 => wire.color = damaged(&mut random, &wire.color),
            1 => wire.depth = damaged(&mut random, &wire.depth),
            2 => wire.labels = damaged(&mut random, &wire.labels),
            _ => {
                let mut bytes = wire.encode_to_vec();
                mutate(&mut random, &mut bytes);
                match v1::Frame::decode(&bytes[..]) {
                    Ok(decoded) => wire = decoded,
                    Err(_) => {
                        unreadable += 1;
                        continue;
                    }
                }
            }
        }
        match check(&wire) {
            Ok(frame) => {
                passed += 1;
                assert_eq!((frame.rgb.len(), frame.depth_metres.len()), (3 * PIXELS, PIXELS));
                assert!(frame.depth_metres.iter().all(|depth| depth.is_finite()));
            }
            Err(refusal) => {
                refused += 1;
                assert!(!refusal.field.is_empty() && !refusal.reason.is_empty());
            }
        }
    }
    println!("{passed} passed, {refused} were refused, {unreadable} could not be decoded");
    assert!(passed > 0 && refused > 0 && unreadable > 0);
}
