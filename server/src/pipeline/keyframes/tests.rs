//! Tests of the store of keyframes.

use super::super::downsampled_frame::DownsampledFrame;
use super::super::frame::{Frame, FrameUp, Intrinsics, TrackedPose};
use super::thumbnail::tests::stripes;
use super::*;
use lexsplat_gpu::Gpu;

fn translation(x: f64) -> Isometry3<f64> {
    Isometry3::translation(x, 0.0, 0.0)
}

/// A keyframe with this image; it was taken at x = its sequence number.
fn keyframe(gpu: &Gpu, sequence: u64, image: DownsampledFrame) -> Keyframe {
    let DownsampledFrame { camera, rgb, depth_metres } = image;
    let frame = Frame {
        sequence,
        timestamp_nanos: 0,
        intrinsics: Intrinsics {
            width: camera.width,
            height: camera.height,
            fx: camera.fx.into(),
            fy: camera.fy.into(),
            cx: camera.cx.into(),
            cy: camera.cy.into(),
        },
        rgb,
        depth_metres,
        depth_lag_nanos: 0,
        world_from_camera: None,
        hint: None,
        labels: None,
        held_out: false,
        up: FrameUp::default(),
    };
    let tracked = TrackedPose {
        world_from_camera: translation(sequence as f64),
        covariance: None,
        exposure: [0.0; 2],
        is_estimated: true,
        relocalised: false,
        beside: None,
    };
    let widths = KeyframeWidths { training: 80, tracking: 160, full: true };
    Keyframe::new(gpu, &frame, &tracked, widths).expect("the device has room")
}

/// Keyframes 1, 2 and 3 with stripes of 40, 25 and 16 pixels.
fn store() -> KeyframeStore {
    let gpu = Gpu::new(None).expect("these tests need a vulkan adapter");
    let mut store = KeyframeStore::default();
    for (sequence, stripe) in [(1, 40), (2, 25), (3, 16)] {
        store.add(keyframe(&gpu, sequence, stripes(stripe, 0, 1.0)));
    }
    store
}

#[test]
fn the_most_similar_keyframe_comes_first_until_it_is_forgotten() {
    let mut store = store();
    let lost = Thumbnail::new(&stripes(25, 2, 1.5));
    let first = |store: &KeyframeStore, image: &Thumbnail| {
        let frame = store.most_similar(image, 1)[0].frame;
        (frame.sequence, frame.world_from_camera)
    };
    assert_eq!(first(&store, &lost), (2, translation(2.0)), "shifted a little and brighter");
    assert_ne!(first(&store, &Thumbnail::new(&stripes(40, 2, 1.0))).0, 2);
    store.find_mut(2).expect("it is there").set_pose(&translation(9.0));
    assert_eq!(first(&store, &lost), (2, translation(9.0)));
    store.forget(2);
    assert_ne!(first(&store, &lost).0, 2);
}

#[test]
fn a_forgotten_keyframe_leaves_its_pose_and_frees_its_bytes() {
    let mut store = store();
    let bytes = store.bytes();
    assert!(store.contains(2) && store.len() == 3);
    store.forget(2);
    assert!(!store.contains(2) && store.len() == 2);
    let pose = store.frame(2).expect("its pose is kept").world_from_camera;
    assert_eq!(pose, translation(2.0));
    assert!(store.frame(4).is_none(), "it never was");
    assert_eq!(store.bytes(), bytes / 3 * 2, "the three are of one size");
}

#[test]
fn bytes_count_shared_images_once() {
    let store = store();
    // Full size: 160x120 RGB, depth that the tracker shares, and depth in half precision; half size: RGB,
    // depth and 8 bytes a pixel on the device.
    let (full, half) = (160 * 120, 80 * 60);
    assert_eq!(store.bytes(), 3 * (full * (7 + 2) + half * (7 + 8)));
}

#[test]
fn references_are_the_newest_and_the_oldest_that_overlap() {
    let store = store();
    let camera = &store.at(0).training.camera;
    let sequences = |count, overlap| -> Vec<u64> {
        let found = store.references(camera, &translation(3.0), count, overlap);
        found.iter().map(|keyframe| keyframe.frame.sequence).collect()
    };
    assert_eq!(sequences(3, 0.0), [3, 1, 2]);
    assert_eq!(sequences(2, 0.0), [3, 1]);
    assert_eq!(sequences(3, 0.9), [3], "the others are metres away");
    assert!(KeyframeStore::default().references(camera, &translation(0.0), 3, 0.0).is_empty());
}
