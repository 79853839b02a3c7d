//! Presence: whether the map knows that an object is there or absent, and how well `confidence` is
//! calibrated. Accuracies, reliability curve, expected calibration error, Brier score, and the best
//! logistic fit.
//!
//! The logistic is fitted to the logits of the confidences, which are linear in the server's
//! scores: a logit z becomes scale z + offset. The fit is that of J. Platt, "Probabilistic outputs
//! for support vector machines" (1999), with his targets, by Newton's method. Calibration: M. P.
//! Naeini et al., "Obtaining well calibrated probabilities using Bayesian binning" (2015): the mean
//! over ten bins, weighted by size, of |mean confidence - share there|.

use crate::context::Context;
use crate::error::EvaluateError;
use crate::labels::{Labels, Sight};
use crate::statistics::{mean, spread};
use crate::step::Step;
use crate::uncertainty::{Tally, Uncertainty};
use lexsplat_client::http::{Answer, Question};
use serde::Serialize;

/// Number of views in which each noun is asked.
pub const VIEWS: usize = 6;
/// Bins of a reliability curve.
const BINS: usize = 10;
const NEWTON_STEPS: usize = 50;

/// An answer and the truth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judgement {
    /// The query.
    pub text: String,
    /// The frame that was asked about; absent for the whole map.
    pub frame: Option<u64>,
    /// Whether the object is there.
    pub there: bool,
    /// The server's `present`.
    pub present: bool,
    /// The server's `confidence`.
    pub confidence: f32,
}

impl Judgement {
    /// Judges an answer about the whole map.
    pub fn in_space(answer: &Answer, there: bool) -> Self {
        Self::of(answer, None, there)
    }

    /// Judges an answer about a frame.
    fn in_view(answer: &Answer, frame: u64, there: bool) -> Self {
        Self::of(answer, Some(frame), there)
    }

    fn of(answer: &Answer, frame: Option<u64>, there: bool) -> Self {
        let Answer { text, present, confidence, .. } = answer;
        let (text, present, confidence) = (text.clone(), *present, *confidence);
        Self { text, frame, there, present, confidence }
    }

    /// The logit of the confidence; `None` if it is 0 or 1: either there was no evidence, or its
    /// digits do not suffice.
    fn logit(&self) -> Option<f64> {
        let confidence = f64::from(self.confidence);
        let logit = (confidence / (1.0 - confidence)).ln();
        logit.is_finite().then_some(logit)
    }

    fn is_right(&self) -> bool {
        self.present == self.there
    }
}

/// Answers of similar confidence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bin {
    /// Number of answers.
    pub count: usize,
    /// Mean of their confidences.
    pub confidence: f64,
    /// Share of objects that are there.
    pub there: f64,
}

/// Calibration of the confidences.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reliability {
    /// Expected calibration error.
    pub ece: f64,
    /// Mean of (confidence - there)².
    pub brier: f64,
    /// Bins that are not empty, by confidence.
    pub bins: Vec<Bin>,
}

/// The best logistic fit. A manifest's `confidence_steepness` s becomes s scale, and its
/// `present_threshold` p becomes p - offset / (s scale).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Fitted {
    /// Factor of the logit.
    pub scale: f64,
    /// Added to the scaled logit.
    pub offset: f64,
    /// Calibration after the fit, on the same answers that it was fitted to.
    pub reliability: Reliability,
}

/// Scores of presence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Presence {
    /// Accuracy for the labels, in the whole map.
    pub present_accuracy: Option<f64>,
    /// Accuracy for absent nouns, in the whole map.
    pub absent_accuracy: Option<f64>,
    /// Accuracy for labels in views that show them.
    pub view_present_accuracy: Option<f64>,
    /// Accuracy for absent nouns, and for labels in views that do not show them.
    pub view_absent_accuracy: Option<f64>,
    /// Calibration over all answers.
    pub reliability: Reliability,
    /// The best fit; absent if all objects are there or none is.
    pub fitted: Option<Fitted>,
    /// All answers.
    pub judgements: Vec<Judgement>,
}

/// Asks for things that are there in the whole map.
pub(crate) async fn ask_for(
    context: &Context<'_>,
    texts: &[String],
) -> Result<Vec<Judgement>, EvaluateError> {
    in_space(context, texts, true).await
}

/// Asks for absent nouns in the whole map, and for absent nouns and labels in some views. Counts the pixels
/// of the answers about views by their uncertainty.
pub(crate) async fn ask(
    context: &Context<'_>,
    labels: &Labels<'_>,
    on_step: &mut impl FnMut(Step<'_>),
) -> Result<(Vec<Judgement>, Option<Uncertainty>), EvaluateError> {
    let mut judgements = in_space(context, &labels.absent, false).await?;
    let mut tally = Tally::new();
    let views = spread(&labels.frames, VIEWS);
    for (done, &index) in views.iter().enumerate() {
        on_step(Step::Judging { done, of: views.len() });
        let (frame, sights) = (context.dataset.sequence(index), labels.sights.of(index)?);
        let sights = labels.labels.iter().zip(&sights).filter_map(|(label, sight)| match sight {
            Sight::Shown(place) => Some((&label.query, Some(place))),
            Sight::Hidden => Some((&label.query, None)),
            Sight::Unclear => None,
        });
        for (noun, place) in sights.chain(labels.absent.iter().map(|noun| (noun, None))) {
            let question = Question::in_frame(noun, frame);
            let answer = context.client.query(context.map, &question).await?;
            let relevancy = context.image(noun, answer.heatmap.as_ref()).await?;
            let uncertainty = context.image(noun, answer.uncertainty.as_ref()).await?;
            tally.add(&relevancy, &uncertainty, answer.threshold, place);
            judgements.push(Judgement::in_view(&answer, frame, place.is_some()));
        }
    }
    on_step(Step::Judging { done: views.len(), of: views.len() });
    Ok((judgements, tally.into_uncertainty()))
}

async fn in_space(
    context: &Context<'_>,
    texts: &[String],
    there: bool,
) -> Result<Vec<Judgement>, EvaluateError> {
    let mut judgements = Vec::with_capacity(texts.len());
    for text in texts {
        let answer = context.client.query(context.map, &Question::in_space(text)).await?;
        judgements.push(Judgement::in_space(&answer, there));
    }
    Ok(judgements)
}

impl Presence {
    /// Whether the map says that a label is there; `None` if it was not asked for.
    pub(crate) fn of_label(&self, query: &str) -> Option<bool> {
        let mut own = self.judgements.iter().filter(|one| one.frame.is_none() && one.there);
        own.find(|one| one.text == query).map(|one| one.present)
    }

    /// Scores answers; `labels` are those that count for the whole map.
    pub fn of(judgements: Vec<Judgement>, labels: &[String]) -> Self {
        let accuracy = |test: &dyn Fn(&Judgement) -> bool| {
            let own = judgements.iter().filter(|one| test(one));
            mean(own.map(|one| f64::from(u8::from(one.is_right()))))
        };
        let in_space = |one: &Judgement| one.frame.is_none();
        Self {
            present_accuracy: accuracy(&|one| {
                in_space(one) && one.there && labels.contains(&one.text)
            }),
            absent_accuracy: accuracy(&|one| in_space(one) && !one.there),
            view_present_accuracy: accuracy(&|one| !in_space(one) && one.there),
            view_absent_accuracy: accuracy(&|one| !in_space(one) && !one.there),
            reliability: reliability(
                judgements.iter().map(|one| (f64::from(one.confidence), one.there)),
            ),
            fitted: fitted(&judgements),
            judgements,
        }
    }
}

/// Calibration of pairs of a confidence and whether the object is there.
fn reliability(answers: impl Iterator<Item = (f64, bool)>) -> Reliability {
    // Number of answers, sum of confidences, number of objects there.
    let mut bins = [(0_usize, 0.0, 0_usize); BINS];
    let (mut squares, mut all) = (0.0, 0_usize);
    for (confidence, there) in answers {
        let bin = &mut bins[((confidence * BINS as f64) as usize).min(BINS - 1)];
        *bin = (bin.0 + 1, bin.1 + confidence, bin.2 + usize::from(there));
        squares += (confidence - f64::from(u8::from(there))).powi(2);
        all += 1;
    }
    let bins: Vec<Bin> = bins
        .into_iter()
        .filter(|bin| bin.0 > 0)
        .map(|(count, sum, there)| Bin {
            count,
            confidence: sum / count as f64,
            there: there as f64 / count as f64,
        })
        .collect();
    let off = bins.iter().map(|bin| bin.count as f64 * (bin.confidence - bin.there).abs());
    let all = all.max(1) as f64;
    Reliability { ece: off.sum::<f64>() / all, brier: squares / all, bins }
}

/// The best logistic fit; answers without a logit keep their confidence.
fn fitted(judgements: &[Judgement]) -> Option<Fitted> {
    let scored: Vec<(f64, bool)> =
        judgements.iter().filter_map(|one| Some((one.logit()?, one.there))).collect();
    let (scale, offset) = platt(&scored)?;
    let confidence = |one: &Judgement| {
        let better = |logit: f64| 1.0 / (1.0 + (-(scale * logit + offset)).exp());
        one.logit().map_or(f64::from(one.confidence), better)
    };
    let reliability = reliability(judgements.iter().map(|one| (confidence(one), one.there)));
    Some(Fitted { scale, offset, reliability })
}

/// (a, b) of 1 / (1 + exp(-(a x + b))); `None` if all or no objects are there, or if a is not
/// positive.
fn platt(scored: &[(f64, bool)]) -> Option<(f64, f64)> {
    let there = scored.iter().filter(|(_, there)| *there).count();
    let absent = scored.len() - there;
    if there == 0 || absent == 0 {
        return None;
    }
    // Platt's targets are not quite 0 and 1, so that perfectly separated scores have a finite fit.
    let (yes, no) = ((there as f64 + 1.0) / (there as f64 + 2.0), 1.0 / (absent as f64 + 2.0));
    let middle = mean(scored.iter().map(|(x, _)| *x)).unwrap_or_default();
    let (mut a, mut b) = (0.0, (there as f64 / absent as f64).ln());
    let loss = |a: f64, b: f64| -> f64 {
        let term = |&(x, there): &(f64, bool)| {
            let (z, target) = (a * (x - middle) + b, if there { yes } else { no });
            // log(1 + exp(z)) - target z, without overflow.
            z.max(0.0) + (-z.abs()).exp().ln_1p() - target * z
        };
        scored.iter().map(term).sum()
    };
    for _ in 0..NEWTON_STEPS {
        let (mut g, mut h) = ([0.0; 2], [1e-12, 0.0, 1e-12]);
        for &(x, there) in scored {
            let x = x - middle;
            let p = 1.0 / (1.0 + (-(a * x + b)).exp());
            let off = p - if there { yes } else { no };
            g = [g[0] + off * x, g[1] + off];
            let w = p * (1.0 - p);
            h = [h[0] + w * x * x, h[1] + w * x, h[2] + w];
        }
        let determinant = h[0] * h[2] - h[1] * h[1];
        let (da, db) =
            ((h[2] * g[0] - h[1] * g[1]) / determinant, (h[0] * g[1] - h[1] * g[0]) / determinant);
        // The step is halved until the loss does not increase.
        let mut share = 1.0;
        while share > 1e-6 && loss(a - share * da, b - share * db) > loss(a, b) {
            share *= 0.5;
        }
        (a, b) = (a - share * da, b - share * db);
        if (share * da).abs() < 1e-10 * (1.0 + a.abs()) && (share * db).abs() < 1e-10 {
            break;
        }
    }
    (a > 0.0 && a.is_finite() && b.is_finite()).then_some((a, b - a * middle))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judgement(confidence: f32, there: bool) -> Judgement {
        let present = confidence >= 0.5;
        Judgement { text: "sofa".into(), frame: None, there, present, confidence }
    }

    #[test]
    fn the_fit_is_that_of_scipy() {
        // scipy.optimize.minimize (1.17.1, BFGS, then Nelder-Mead) of sum(logaddexp(0, z) - y z)
        // with z = a x + b, y Platt's targets, x = (i * 37 % 101) / 100, there: sin(5 x^2 + i) + 3
        // x > 1.7, i = 0..80.
        let scored: Vec<(f64, bool)> = (0..80)
            .map(|i| {
                let x = f64::from(i * 37 % 101) / 100.0;
                (x, (5.0 * x * x + f64::from(i)).sin() + 3.0 * x > 1.7)
            })
            .collect();
        let (a, b) = platt(&scored).unwrap();
        assert!((a - 6.066_464_75).abs() < 1e-5 && (b + 3.374_453_08).abs() < 1e-5, "{a} {b}");
    }

    #[test]
    fn separated_scores_have_a_finite_fit_and_inverted_ones_none() {
        let scored: Vec<(f64, bool)> = (0..20).map(|i| (f64::from(i), i >= 10)).collect();
        let (a, b) = platt(&scored).unwrap();
        assert!(a.is_finite() && (-b / a - 9.5).abs() < 0.01, "{a} {b}");
        let contrary: Vec<(f64, bool)> = scored.iter().map(|(x, there)| (*x, !there)).collect();
        assert_eq!(platt(&contrary), None);
        assert_eq!(platt(&scored[..10]), None);
        assert_eq!(platt(&[]), None);
    }

    #[test]
    fn calibrated_confidences_score_well_and_overconfident_ones_badly() {
        // Seven in ten at 0.7.
        let honest: Vec<(f64, bool)> = (0..10).map(|i| (0.7, i < 7)).collect();
        let found = reliability(honest.iter().copied());
        assert!(found.ece < 1e-9 && (found.brier - 0.21).abs() < 1e-9, "{found:?}");
        assert_eq!(found.bins.len(), 1);
        let boasting = reliability(honest.iter().map(|(_, there)| (1.0, *there)));
        assert!((boasting.ece - 0.3).abs() < 1e-9, "{boasting:?}");
        assert_eq!(reliability([].into_iter()).bins, []);
    }

    #[test]
    fn accuracies_separate_labels_from_other_classes() {
        let mut judgements =
            vec![judgement(0.9, true), judgement(0.6, false), judgement(0.0, false)];
        judgements.push(Judgement { text: "lamp".into(), ..judgement(0.0, true) });
        judgements.push(Judgement { frame: Some(3), ..judgement(0.0, false) });
        let presence = Presence::of(judgements, &["sofa".to_owned()]);
        assert_eq!(presence.present_accuracy, Some(1.0), "the lamp was no label");
        assert_eq!(presence.absent_accuracy, Some(0.5));
        assert_eq!(
            (presence.view_present_accuracy, presence.view_absent_accuracy),
            (None, Some(1.0))
        );
        assert!(presence.fitted.is_some());
    }
}
