//! Checks of label images and their texts.

use super::{HEIGHT, LIMITS, PIXELS, WIDTH, check, good, open_message, png, rgb, u16_bytes};
use crate::check::{frame, opening};
use image::ExtendedColorType;
use lexsplat_proto::v1;

fn labels() -> Vec<u16> {
    (0..PIXELS).map(|at| (at % 4) as u16).collect()
}

fn with_labels(format: v1::LabelFormat, labels: Vec<u8>) -> v1::Frame {
    v1::Frame { label_format: format.into(), labels: labels.into(), ..good() }
}

#[test]
fn labels_come_in_every_format_and_keep_their_texts() {
    use v1::LabelFormat::{Png, U16, U16Zstd};
    let (ids, bytes) = (labels(), u16_bytes(&labels()));
    let narrow: Vec<u8> = ids.iter().map(|id| *id as u8).collect();
    let wide: Vec<u8> = ids.iter().flat_map(|id| id.to_ne_bytes()).collect();
    let ways = [
        with_labels(U16, bytes.clone()),
        with_labels(U16Zstd, zstd::encode_all(&bytes[..], 1).unwrap()),
        with_labels(Png, png(&narrow, WIDTH, HEIGHT, ExtendedColorType::L8)),
        with_labels(Png, png(&wide, WIDTH, HEIGHT, ExtendedColorType::L16)),
    ];
    for wire in ways {
        let found = check(&wire).unwrap().labels.expect("it carries labels");
        assert_eq!(*found.ids, ids);
        assert_eq!(*found.texts, ["wall", "sofa", ""], "without white space around");
    }
    assert!(check(&good()).unwrap().labels.is_none());
}

#[test]
fn labels_that_cannot_be_are_refused() {
    use v1::LabelFormat::{Png, U16, U16Zstd, Unspecified};
    let bytes = u16_bytes(&labels());
    let refused = |wire: v1::Frame| {
        let refusal = check(&wire).expect_err("it is refused");
        (refusal.field, refusal.reason)
    };
    let mut unknown = labels();
    unknown[33] = 4;
    let (field, reason) = refused(with_labels(U16, u16_bytes(&unknown)));
    assert_eq!(field, "labels");
    assert!(reason.contains("0 to 3") && reason.contains("found 4 at column 1, row 1"), "{reason}");
    assert!(refused(with_labels(U16, bytes[2..].to_vec())).1.contains("expected 1536 bytes"));
    assert!(refused(with_labels(U16Zstd, vec![1, 2, 3])).1.contains("not zstd"));
    assert!(refused(with_labels(Png, bytes.clone())).1.contains("not a PNG"));
    let color = png(&rgb(), WIDTH, HEIGHT, ExtendedColorType::Rgb8);
    assert!(refused(with_labels(Png, color)).1.contains("grey PNG"));
    let small = png(&[0; 4], 2, 2, ExtendedColorType::L8);
    assert!(refused(with_labels(Png, small)).1.contains("expected 32x24"));
    assert_eq!(refused(with_labels(Unspecified, bytes.clone())).0, "label_format");
    let nameless = v1::Frame { label_format: 9, ..good() };
    assert!(refused(nameless).1.contains("LABEL_FORMAT_PNG"));
    // The labels have no texts.
    let open = v1::OpenMap { label_texts: Vec::new(), ..open_message() };
    let opened = opening(&open, &LIMITS).unwrap();
    let refusal = frame(&with_labels(U16, bytes), &opened, None, &LIMITS).unwrap_err();
    assert!(refusal.reason.contains("without label_texts"), "{refusal}");
}

#[test]
fn label_texts_are_not_endless() {
    let opened = |label_texts| opening(&v1::OpenMap { label_texts, ..open_message() }, &LIMITS);
    assert_eq!(opened(vec!["chair".into(); 65_535]).unwrap().label_texts.len(), 65_535);
    let refusal = opened(vec!["chair".into(); 65_536]).unwrap_err();
    assert_eq!(refusal.field, "label_texts");
    assert!(refusal.reason.contains("65535"), "{refusal}");
    let refusal = opened(vec!["chair".into(), "c".repeat(1025)]).unwrap_err();
    assert!(refusal.reason.contains("1024 bytes, found 1025 at 1"), "{refusal}");
}
