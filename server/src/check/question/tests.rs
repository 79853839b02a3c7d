//! Each check of a question.

use super::*;
use crate::pipeline::query::{MAX_NEGATIVES, MAX_TEXT_BYTES, MAX_TEXTS, Outputs};
use nalgebra::Point3;

fn plain(text: &str) -> Unchecked {
    Unchecked { text: text.into(), ..Unchecked::default() }
}

fn field(question: Unchecked) -> String {
    question.one().err().map(|refusal| refusal.field).unwrap_or_default()
}

#[test]
fn a_plain_question_gets_the_outputs_that_fit() {
    let query = plain("  coffee cup ").one().unwrap();
    assert_eq!((query.text.as_str(), query.max_objects), ("coffee cup", 10));
    assert_eq!(query.outputs, Outputs::SPACE);
    let view = Some(View::Frame(3));
    let query = Unchecked { view, ..plain("cup") }.one().unwrap();
    assert_eq!(query.outputs, Outputs::VIEW);
}

#[test]
fn several_texts_are_another_kind_of_question() {
    let several = |texts: &[&str]| Unchecked {
        texts: texts.iter().map(|&text| text.to_owned()).collect(),
        ..plain("")
    };
    let field = |question: Unchecked| {
        question.checked().err().map(|refusal| refusal.field).unwrap_or_default()
    };
    let Question::Texts(segmentation) = several(&["cup", " sofa "]).checked().unwrap() else {
        panic!("two texts are several")
    };
    assert_eq!(segmentation.texts, ["cup", "sofa"]);
    assert!(matches!(plain("cup").checked(), Ok(Question::Text(_))));
    assert!(matches!(several(&["cup"]).checked(), Ok(Question::Texts(_))), "or none of them");
    assert_eq!(field(several(&["cup", ""])), "texts[1]");
    assert_eq!(field(several(&["cup", "sofa", "cup "])), "texts[2]");
    assert_eq!(field(several(&["x"; MAX_TEXTS + 1])), "texts");
    assert_eq!(field(Unchecked { text: "cup".into(), ..several(&["a", "b"]) }), "text");
    assert_eq!(field(Unchecked { near: Some([0.0; 3]), ..several(&["a", "b"]) }), "near_metres");
    assert_eq!(
        field(Unchecked { outputs: vec!["mask".into()], ..several(&["a", "b"]) }),
        "outputs"
    );
    assert_eq!(field(Unchecked { threshold: Some(2.0), ..several(&["a", "b"]) }), "threshold");
}

#[test]
fn points_and_boxes_are_finite_ordered_and_only_in_3d_questions() {
    let base = || plain("cup");
    let within = |min, max| Unchecked { within: Some(json::Bounds { min, max }), ..base() };
    let query = within([0.0; 3], [1.0, 0.0, 2.0]).one().unwrap();
    assert_eq!(query.filter.within.unwrap().max, Point3::new(1.0, 0.0, 2.0));
    assert_eq!(field(within([0.0; 3], [1.0, -0.1, 2.0])), "within.max_metres");
    assert_eq!(field(within([0.0, f32::NAN, 0.0], [1.0; 3])), "within.min_metres");
    let near = Some([0.0, f32::INFINITY, 0.0]);
    assert_eq!(field(Unchecked { near, ..base() }), "near_metres");
    let (near, view) = (Some([0.0; 3]), Some(View::Frame(1)));
    assert_eq!(field(Unchecked { near, ..base() }), "");
    assert_eq!(field(Unchecked { near, view, ..base() }), "near_metres");
}

#[test]
fn each_check_names_its_field() {
    let base = || plain("cup");
    assert_eq!(field(base()), "");
    assert_eq!(field(plain(" \n")), "text");
    assert_eq!(field(plain(&"x".repeat(10_000))), "text");
    assert_eq!(field(plain(&"x".repeat(MAX_TEXT_BYTES))), "");
    let negatives = vec!["object".into(), String::new()];
    assert_eq!(field(Unchecked { negatives, ..base() }), "negatives[1]");
    let negatives = vec!["object".into(); MAX_NEGATIVES + 1];
    assert_eq!(field(Unchecked { negatives, ..base() }), "negatives");
    for (threshold, wanted) in
        [(-0.1, "threshold"), (1.5, "threshold"), (f32::NAN, "threshold"), (0.5, ""), (1.0, "")]
    {
        assert_eq!(field(Unchecked { threshold: Some(threshold), ..base() }), wanted);
    }
    assert_eq!(field(Unchecked { smoothing_pixels: Some(513), ..base() }), "smoothing_pixels");
    assert_eq!(field(Unchecked { smoothing_pixels: Some(0), ..base() }), "");
    assert_eq!(field(Unchecked { max_objects: Some(0), ..base() }), "max_objects");
    assert_eq!(field(Unchecked { max_objects: Some(1), ..base() }), "");
    assert_eq!(field(Unchecked { outputs: vec!["heat".into()], ..base() }), "outputs");
    assert_eq!(field(Unchecked { outputs: vec!["mask".into()], ..base() }), "outputs");
    assert_eq!(field(Unchecked { outputs: vec!["points".into()], ..base() }), "");
}
