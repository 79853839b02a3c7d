//! Uncertainty of pixels: whether those that the server calls uncertain are wrong more often, and as often
//! as it says.
//!
//! A pixel of an answer is wrong if it is in the mask and shows something else, or the other way round.
//! Pixels are counted in narrow bins of uncertainty, because an evaluation has tens of millions of them.
//! Tenths of the pixels, from the least to the most certain, are cut out of these bins.

use crate::heatmap::Heatmap;
use crate::labels::Place;
use serde::Serialize;

/// Narrow bins that pixels are counted in.
const BINS: usize = 2000;
/// Parts of equal size that are reported.
const PARTS: usize = 10;

/// Pixels of similar uncertainty.
#[derive(Clone, Copy, Debug, Default)]
struct Count {
    pixels: f64,
    wrong: f64,
    /// Sum of the uncertainties.
    sum: f64,
}

/// Pixels of answers about views, counted by uncertainty.
pub(crate) struct Tally {
    bins: Vec<Count>,
}

/// A tenth of the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Part {
    /// Mean uncertainty.
    pub uncertainty: f64,
    /// Share of the pixels that are wrong.
    pub wrong: f64,
}

/// How well uncertainties predict errors.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Uncertainty {
    /// Number of pixels with language, over all answers.
    pub pixels: u64,
    /// Share that is wrong.
    pub wrong: f64,
    /// Share of the least certain tenth that is wrong.
    pub wrong_least_certain: f64,
    /// Share of the other pixels that is wrong.
    pub wrong_rest: f64,
    /// Mean over the tenths of |mean uncertainty - share wrong|.
    pub calibration_error: f64,
    /// The tenths, least certain first.
    pub tenths: Vec<Part>,
}

impl Tally {
    pub fn new() -> Self {
        Self { bins: vec![Count::default(); BINS] }
    }

    /// Counts the pixels with language of an answer. `place`: where the object is; `None`: nowhere.
    pub fn add(
        &mut self,
        relevancy: &Heatmap,
        uncertainty: &Heatmap,
        threshold: f32,
        place: Option<&Place>,
    ) {
        let width = relevancy.width;
        let pixels = relevancy.values.iter().zip(&uncertainty.values).enumerate();
        for (at, (&found, &uncertain)) in pixels.filter(|(_, (found, _))| **found > 0.0) {
            let is_there = place.is_some_and(|place| match &place.mask {
                Some(mask) => mask[at],
                None => place.boxes.iter().any(|bounds| bounds.holds(at % width, at / width)),
            });
            let uncertain = f64::from(uncertain).clamp(0.0, 1.0);
            let bin = &mut self.bins[((uncertain * BINS as f64) as usize).min(BINS - 1)];
            bin.pixels += 1.0;
            bin.wrong += f64::from(u8::from((found > threshold) != is_there));
            bin.sum += uncertain;
        }
    }

    /// The tenths of the pixels, least certain first; `None` without pixels.
    pub fn into_uncertainty(self) -> Option<Uncertainty> {
        let pixels: f64 = self.bins.iter().map(|bin| bin.pixels).sum();
        let wrong: f64 = self.bins.iter().map(|bin| bin.wrong).sum();
        if pixels == 0.0 {
            return None;
        }
        let mut parts = [Count::default(); PARTS];
        let mut before = 0.0;
        for bin in self.bins.iter().rev().filter(|bin| bin.pixels > 0.0) {
            let until = before + bin.pixels;
            for (at, part) in parts.iter_mut().enumerate() {
                let (from, to) = (pixels * at as f64 / 10.0, pixels * (at + 1) as f64 / 10.0);
                // A bin on the border of two parts is divided among them.
                let share = (until.min(to) - before.max(from)).max(0.0) / bin.pixels;
                part.pixels += bin.pixels * share;
                part.wrong += bin.wrong * share;
                part.sum += bin.sum * share;
            }
            before = until;
        }
        let tenth = |part: &Count| Part {
            uncertainty: part.sum / part.pixels,
            wrong: part.wrong / part.pixels,
        };
        let tenths: Vec<Part> = parts.iter().map(tenth).collect();
        let off = tenths.iter().map(|part| (part.uncertainty - part.wrong).abs());
        let [first, rest @ ..] = &parts;
        Some(Uncertainty {
            pixels: pixels as u64,
            wrong: wrong / pixels,
            wrong_least_certain: tenths[0].wrong,
            wrong_rest: rest.iter().map(|part| part.wrong).sum::<f64>() / (pixels - first.pixels),
            calibration_error: off.sum::<f64>() / PARTS as f64,
            tenths,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::score::boxes;

    const WIDTH: usize = 100;

    /// An answer about a row of pixels: the right half is found, the last tenth of the row is not there.
    fn answer(uncertainty: impl Fn(usize) -> f32) -> Uncertainty {
        let image = |values: Vec<f32>| Heatmap { width: WIDTH, values };
        let relevancy = image((0..WIDTH).map(|at| if at < 50 { 0.1 } else { 0.9 }).collect());
        let mask: Vec<bool> = (0..WIDTH).map(|at| (50..90).contains(&at)).collect();
        let place = Place { boxes: boxes(&mask, WIDTH), mask: Some(mask) };
        let uncertainty = image((0..WIDTH).map(uncertainty).collect());
        let mut tally = Tally::new();
        tally.add(&relevancy, &uncertainty, 0.5, Some(&place));
        tally.into_uncertainty().unwrap()
    }

    #[test]
    fn good_uncertainties_have_all_errors_in_the_least_certain_tenth() {
        let good = answer(|at| if at >= 90 { 0.9 } else { 0.01 });
        assert!((good.wrong - 0.1).abs() < 1e-9 && good.pixels == 100, "{good:?}");
        assert!(
            (good.wrong_least_certain - 1.0).abs() < 1e-9 && good.wrong_rest < 1e-9,
            "{good:?}"
        );
        assert!(good.calibration_error < 0.03, "{good:?}");
        // Negative control: the opposite.
        let bad = answer(|at| if at >= 90 { 0.01 } else { 0.9 });
        assert!(bad.wrong_least_certain < 0.01 && bad.wrong_rest > 0.1, "{bad:?}");
        assert!(bad.calibration_error > 0.5, "{bad:?}");
    }

    #[test]
    fn equal_uncertainties_tell_nothing() {
        let flat = answer(|_| 0.1);
        assert!((flat.wrong_least_certain - 0.1).abs() < 1e-9, "{flat:?}");
        assert!((flat.wrong_rest - 0.1).abs() < 1e-9 && flat.calibration_error < 1e-6, "{flat:?}");
    }

    #[test]
    fn pixels_without_language_do_not_count_and_what_is_nowhere_is_not_found() {
        let image = |values: Vec<f32>| Heatmap { width: 4, values };
        let (relevancy, uncertainty) = (image(vec![0.0, 0.9, 0.2, 0.0]), image(vec![0.5; 4]));
        let mut tally = Tally::new();
        tally.add(&relevancy, &uncertainty, 0.5, None);
        let found = tally.into_uncertainty().unwrap();
        assert_eq!((found.pixels, found.wrong), (2, 0.5));
        assert_eq!(Tally::new().into_uncertainty(), None);
    }
}
