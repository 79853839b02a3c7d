//! Checks of a question in plain words, for gRPC and HTTP alike.

use super::Refusal;
use crate::pipeline::query::{
    Bounds, Contest, MAX_NEGATIVES, MAX_TEXT_BYTES, MAX_TEXTS, Outputs, Place, Query, View,
};
use nalgebra::Point3;

/// Objects in an answer if the asker does not say.
const DEFAULT_MAX_OBJECTS: usize = 10;
/// The most objects in an answer.
const MAX_OBJECTS: u32 = 1000;
/// The widest mean filter, pixels.
const MAX_SMOOTHING_PIXELS: u32 = 512;

/// A question as it came, but for its view, which is checked where its form is known.
#[derive(Clone, Debug, Default)]
pub struct Question {
    /// What is looked for.
    pub text: String,
    /// What it is not.
    pub negatives: Vec<String>,
    /// From where.
    pub view: Option<View>,
    /// Names of outputs; empty: all that fit.
    pub outputs: Vec<String>,
    /// Relevancy above which something counts.
    pub threshold: Option<f32>,
    /// Side of the mean filter, pixels.
    pub smoothing_pixels: Option<u32>,
    /// The most objects.
    pub max_objects: Option<u32>,
    /// Several texts instead of one: which of them is what?
    pub texts: Vec<String>,
    /// Objects nearest to this point first, metres.
    pub near: Option<[f32; 3]>,
    /// Only what is between these corners, metres.
    pub within: Option<[[f32; 3]; 2]>,
}

/// A checked question of either kind.
#[derive(Clone, Debug)]
pub enum Asked {
    /// Where is it?
    One(Query),
    /// Which of them is what?
    Several(Contest),
}

impl Question {
    /// These words, and nothing else said.
    pub fn about(text: &str) -> Self {
        Self { text: text.to_owned(), ..Self::default() }
    }

    /// Checks it, whether it has one text or several. `smoothing_field` is that field's name on the
    /// asker's wire.
    ///
    /// # Errors
    /// [`Refusal`] names the field.
    pub fn asked(self, smoothing_field: &str) -> Result<Asked, Refusal> {
        match self.texts.is_empty() {
            true => self.checked(smoothing_field).map(Asked::One),
            false => self.contest(smoothing_field).map(Asked::Several),
        }
    }

    fn contest(self, smoothing_field: &str) -> Result<Contest, Refusal> {
        let not_for_several = [
            ("text", !self.text.is_empty()),
            ("outputs", !self.outputs.is_empty()),
            ("max_objects", self.max_objects.is_some()),
            ("near", self.near.is_some()),
            ("within", self.within.is_some()),
        ];
        if let Some((field, _)) = not_for_several.into_iter().find(|(_, given)| *given) {
            return Err(Refusal::new(field, "expected nothing beside texts"));
        }
        let found = self.texts.len();
        if !(2..=MAX_TEXTS).contains(&found) {
            return Err(Refusal::new("texts", format!("expected 2 to {MAX_TEXTS}, found {found}")));
        }
        let mut texts: Vec<String> = Vec::with_capacity(found);
        for (at, text) in self.texts.iter().enumerate() {
            let field = format!("texts[{at}]");
            let text = words(&field, text)?;
            if texts.contains(&text) {
                return Err(Refusal::new(
                    field,
                    format!("expected another text, found {text:?} again"),
                ));
            }
            texts.push(text);
        }
        Ok(Contest {
            texts,
            negatives: negatives(&self.negatives)?,
            view: self.view,
            threshold: threshold(self.threshold)?,
            smoothing_pixels: smoothing(smoothing_field, self.smoothing_pixels)?,
        })
    }

    /// Checks a question with one text. `smoothing_field` is that field's name on the asker's wire.
    ///
    /// # Errors
    /// [`Refusal`] names the field.
    pub fn checked(self, smoothing_field: &str) -> Result<Query, Refusal> {
        let text = words("text", &self.text)?;
        let place = place(self.near, self.within, self.view.is_some())?;
        let max_objects = match self.max_objects {
            None => DEFAULT_MAX_OBJECTS,
            Some(count @ 1..=MAX_OBJECTS) => count as usize,
            Some(found) => {
                let reason = format!("expected 1 to {MAX_OBJECTS}, found {found}");
                return Err(Refusal::new("max_objects", reason));
            }
        };
        Ok(Query {
            outputs: outputs(&self.outputs, self.view.is_some())?,
            text,
            negatives: negatives(&self.negatives)?,
            view: self.view,
            threshold: threshold(self.threshold)?,
            smoothing_pixels: smoothing(smoothing_field, self.smoothing_pixels)?,
            max_objects,
            place,
        })
    }
}

fn negatives(given: &[String]) -> Result<Vec<String>, Refusal> {
    if given.len() > MAX_NEGATIVES {
        let reason = format!("expected at most {MAX_NEGATIVES}, found {}", given.len());
        return Err(Refusal::new("negatives", reason));
    }
    let each = |(at, negative): (usize, &String)| words(&format!("negatives[{at}]"), negative);
    given.iter().enumerate().map(each).collect()
}

fn threshold(given: Option<f32>) -> Result<Option<f32>, Refusal> {
    match given {
        Some(found) if !(0.0..=1.0).contains(&found) => {
            Err(Refusal::new("threshold", format!("expected 0 to 1, found {found}")))
        }
        good => Ok(good),
    }
}

fn smoothing(field: &str, given: Option<u32>) -> Result<Option<u32>, Refusal> {
    match given {
        Some(found) if found > MAX_SMOOTHING_PIXELS => {
            let reason = format!("expected 0 to {MAX_SMOOTHING_PIXELS} pixels, found {found}");
            Err(Refusal::new(field, reason))
        }
        good => Ok(good),
    }
}

fn place(
    near: Option<[f32; 3]>,
    within: Option<[[f32; 3]; 2]>,
    has_view: bool,
) -> Result<Place, Refusal> {
    let given = [("near", near.is_some()), ("within", within.is_some())];
    if let Some((field, _)) = given.into_iter().find(|(_, given)| *given && has_view) {
        return Err(Refusal::new(field, "expected a question without a view: it is about space"));
    }
    let near = near.map(|point| finite("near", point)).transpose()?;
    let within = within.map(|[min, max]| {
        let bounds = Bounds { min: finite("within.min", min)?, max: finite("within.max", max)? };
        let ordered = (0..3).all(|axis| bounds.min[axis] <= bounds.max[axis]);
        let reason = || format!("expected no coordinate below within.min {min:?}, found {max:?}");
        if ordered { Ok(bounds) } else { Err(Refusal::new("within.max", reason())) }
    });
    Ok(Place { near, within: within.transpose()? })
}

fn finite(field: &str, point: [f32; 3]) -> Result<Point3<f32>, Refusal> {
    match point.iter().all(|part| part.is_finite()) {
        true => Ok(Point3::from(point)),
        false => Err(Refusal::new(field, format!("expected finite metres, found {point:?}"))),
    }
}

fn words(field: &str, text: &str) -> Result<String, Refusal> {
    let text = text.trim();
    if text.is_empty() {
        return Err(Refusal::new(field, "expected words, found nothing"));
    }
    if text.len() > MAX_TEXT_BYTES {
        let found = text.len();
        return Err(Refusal::new(
            field,
            format!("expected at most {MAX_TEXT_BYTES} bytes, found {found}"),
        ));
    }
    Ok(text.to_owned())
}

fn outputs(names: &[String], has_view: bool) -> Result<Outputs, Refusal> {
    if names.is_empty() {
        return Ok(if has_view { Outputs::VIEW } else { Outputs::SPACE });
    }
    let mut outputs = Outputs::NONE;
    for name in names {
        let (output, needs_view) = match name.as_str() {
            "heatmap" => (&mut outputs.heatmap, true),
            "mask" => (&mut outputs.mask, true),
            "boxes" => (&mut outputs.boxes, true),
            "points" => (&mut outputs.points, false),
            "objects" => (&mut outputs.objects, false),
            other => {
                let reason = format!(
                    "expected heatmap, mask, boxes, points or objects, found {:?}",
                    other.chars().take(40).collect::<String>()
                );
                return Err(Refusal::new("outputs", reason));
            }
        };
        if needs_view && !has_view {
            return Err(Refusal::new(
                "outputs",
                format!("{name} needs a view, and none was given"),
            ));
        }
        *output = true;
    }
    Ok(outputs)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(question: Question) -> String {
        question.checked("smoothing").err().map(|refusal| refusal.field).unwrap_or_default()
    }

    #[test]
    fn a_plain_question_gets_what_fits() {
        let query = Question::about("  coffee cup ").checked("smoothing").unwrap();
        assert_eq!((query.text.as_str(), query.max_objects), ("coffee cup", 10));
        assert_eq!(query.outputs, Outputs::SPACE);
        let view = Some(View::Frame(3));
        let query = Question { view, ..Question::about("cup") }.checked("smoothing").unwrap();
        assert_eq!(query.outputs, Outputs::VIEW);
    }

    #[test]
    fn several_texts_are_another_kind_of_question() {
        let several = |texts: &[&str]| Question {
            texts: texts.iter().map(|&text| text.to_owned()).collect(),
            ..Question::default()
        };
        let field = |question: Question| {
            question.asked("smoothing").err().map(|refusal| refusal.field).unwrap_or_default()
        };
        let Asked::Several(contest) = several(&["cup", " sofa "]).asked("smoothing").unwrap()
        else {
            panic!("two texts are several")
        };
        assert_eq!(contest.texts, ["cup", "sofa"]);
        assert!(matches!(Question::about("cup").asked("smoothing"), Ok(Asked::One(_))));
        assert_eq!(field(several(&["cup"])), "texts");
        assert_eq!(field(several(&["cup", ""])), "texts[1]");
        assert_eq!(field(several(&["cup", "sofa", "cup "])), "texts[2]");
        assert_eq!(field(several(&["x"; MAX_TEXTS + 1])), "texts");
        assert_eq!(field(Question { text: "cup".into(), ..several(&["a", "b"]) }), "text");
        assert_eq!(field(Question { near: Some([0.0; 3]), ..several(&["a", "b"]) }), "near");
        assert_eq!(
            field(Question { outputs: vec!["mask".into()], ..several(&["a", "b"]) }),
            "outputs"
        );
        assert_eq!(field(Question { threshold: Some(2.0), ..several(&["a", "b"]) }), "threshold");
    }

    #[test]
    fn places_are_finite_ordered_and_in_space() {
        let base = || Question::about("cup");
        let within = |min, max| Question { within: Some([min, max]), ..base() };
        let query = within([0.0; 3], [1.0, 0.0, 2.0]).checked("smoothing").unwrap();
        assert_eq!(query.place.within.unwrap().max, Point3::new(1.0, 0.0, 2.0));
        assert_eq!(field(within([0.0; 3], [1.0, -0.1, 2.0])), "within.max");
        assert_eq!(field(within([0.0, f32::NAN, 0.0], [1.0; 3])), "within.min");
        let near = Some([0.0, f32::INFINITY, 0.0]);
        assert_eq!(field(Question { near, ..base() }), "near");
        let (near, view) = (Some([0.0; 3]), Some(View::Frame(1)));
        assert_eq!(field(Question { near, ..base() }), "");
        assert_eq!(field(Question { near, view, ..base() }), "near");
    }

    #[test]
    fn each_check_names_its_field() {
        let base = || Question::about("cup");
        assert_eq!(field(base()), "");
        assert_eq!(field(Question::about(" \n")), "text");
        assert_eq!(field(Question::about(&"x".repeat(10_000))), "text");
        assert_eq!(field(Question::about(&"x".repeat(MAX_TEXT_BYTES))), "");
        let negatives = vec!["object".into(), String::new()];
        assert_eq!(field(Question { negatives, ..base() }), "negatives[1]");
        let negatives = vec!["object".into(); MAX_NEGATIVES + 1];
        assert_eq!(field(Question { negatives, ..base() }), "negatives");
        for (threshold, wanted) in
            [(-0.1, "threshold"), (1.5, "threshold"), (f32::NAN, "threshold"), (0.5, ""), (1.0, "")]
        {
            assert_eq!(field(Question { threshold: Some(threshold), ..base() }), wanted);
        }
        assert_eq!(field(Question { smoothing_pixels: Some(513), ..base() }), "smoothing");
        assert_eq!(field(Question { smoothing_pixels: Some(0), ..base() }), "");
        assert_eq!(field(Question { max_objects: Some(0), ..base() }), "max_objects");
        assert_eq!(field(Question { max_objects: Some(1), ..base() }), "");
        assert_eq!(field(Question { outputs: vec!["heat".into()], ..base() }), "outputs");
        assert_eq!(field(Question { outputs: vec!["mask".into()], ..base() }), "outputs");
        assert_eq!(field(Question { outputs: vec!["points".into()], ..base() }), "");
    }
}
