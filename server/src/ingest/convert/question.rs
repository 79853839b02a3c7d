//! Checks of a question in plain words, for gRPC and HTTP alike.

use super::Refusal;
use crate::pipeline::query::{MAX_NEGATIVES, MAX_TEXT_BYTES, Outputs, Query, View};

/// Objects in an answer if the asker does not say.
const DEFAULT_MAX_OBJECTS: usize = 10;
/// The most objects in an answer.
const MAX_OBJECTS: u32 = 1000;
/// The widest mean filter, pixels.
const MAX_SMOOTHING_PIXELS: u32 = 512;

/// A question as it came, but for its view, which is checked where its form is known.
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
}

impl Question {
    /// Checks it. `smoothing_field` is that field's name on the asker's wire.
    ///
    /// # Errors
    /// [`Refusal`] names the field.
    pub fn checked(self, smoothing_field: &str) -> Result<Query, Refusal> {
        let text = words("text", &self.text)?;
        if self.negatives.len() > MAX_NEGATIVES {
            let found = self.negatives.len();
            return Err(Refusal::new(
                "negatives",
                format!("expected at most {MAX_NEGATIVES}, found {found}"),
            ));
        }
        let negatives = self
            .negatives
            .iter()
            .enumerate()
            .map(|(at, negative)| words(&format!("negatives[{at}]"), negative))
            .collect::<Result<_, _>>()?;
        if let Some(threshold) = self.threshold.filter(|value| !(0.0..=1.0).contains(value)) {
            return Err(Refusal::new("threshold", format!("expected 0 to 1, found {threshold}")));
        }
        let smoothing_pixels = self.smoothing_pixels;
        if let Some(pixels) = smoothing_pixels.filter(|pixels| *pixels > MAX_SMOOTHING_PIXELS) {
            return Err(Refusal::new(
                smoothing_field,
                format!("expected 0 to {MAX_SMOOTHING_PIXELS} pixels, found {pixels}"),
            ));
        }
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
            negatives,
            view: self.view,
            threshold: self.threshold,
            smoothing_pixels,
            max_objects,
        })
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

    fn question(text: &str) -> Question {
        Question {
            text: text.into(),
            negatives: Vec::new(),
            view: None,
            outputs: Vec::new(),
            threshold: None,
            smoothing_pixels: None,
            max_objects: None,
        }
    }

    fn field(question: Question) -> String {
        question.checked("smoothing").err().map(|refusal| refusal.field).unwrap_or_default()
    }

    #[test]
    fn a_plain_question_gets_what_fits() {
        let query = question("  coffee cup ").checked("smoothing").unwrap();
        assert_eq!((query.text.as_str(), query.max_objects), ("coffee cup", 10));
        assert_eq!(query.outputs, Outputs::SPACE);
        let view = Some(View::Frame(3));
        let query = Question { view, ..question("cup") }.checked("smoothing").unwrap();
        assert_eq!(query.outputs, Outputs::VIEW);
    }

    #[test]
    fn each_check_names_its_field() {
        let base = || question("cup");
        assert_eq!(field(base()), "");
        assert_eq!(field(question(" \n")), "text");
        assert_eq!(field(question(&"x".repeat(10_000))), "text");
        assert_eq!(field(question(&"x".repeat(MAX_TEXT_BYTES))), "");
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
