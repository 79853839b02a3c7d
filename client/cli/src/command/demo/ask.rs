//! Asks the questions of the demo, each about one frame and about the whole map, and judges the
//! answers if there is ground truth.

use super::questions::{self, Sight};
use crate::answer::best_object;
use crate::dataset::DatasetSpec;
use anyhow::{Context as _, Result, bail};
use lexsplat_client::dataset::{Dataset, Instance, Mask, Truth};
use lexsplat_client::http::{Answer, HttpClient, Peak, Question};
use lexsplat_client::npy::Array;
use std::time::Instant;

/// Tolerance of boxes: Gaussians do not end exactly at the true surface.
const BOX_MARGIN_METRES: f64 = 0.1;

/// A frame that can be asked about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct View {
    /// Position in the data set.
    pub index: usize,
    /// Number of the frame.
    pub sequence: u64,
}

/// A question with its answers.
#[derive(Clone, Debug)]
pub struct Asked {
    /// The text of the question.
    pub text: String,
    /// The frame.
    pub view: View,
    /// The answer for the frame.
    pub seen: Answer,
    /// Relevancy of its pixels, `[height, width]`.
    pub relevancy: Array,
    /// The relevancy as a .npy file.
    pub npy: Vec<u8>,
    /// The answer for the whole map.
    pub space: Answer,
    /// Latency of the frame's answer that the client sees.
    pub milliseconds: f64,
    /// The verdict of ground truth; absent if it does not have the class.
    pub verdict: Option<Verdict>,
}

/// The verdict of ground truth about an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// Whether the peak lies on an object of the class.
    pub peak_inside: bool,
    /// Whether the centre of the best object lies in the box of an object of the class.
    pub center_inside: bool,
}

/// Asks a map.
pub struct Asker<'a> {
    /// Client of the server.
    pub client: &'a HttpClient,
    /// Name of the map.
    pub map: &'a str,
    /// The data set that the map was made of.
    pub dataset: &'a dyn Dataset,
}

/// A question, with its frame if ground truth gives one.
type Plan = (String, Option<View>);

impl Asker<'_> {
    /// Asks the given texts, or questions that suit the data set if there are none.
    ///
    /// # Errors
    /// If a request fails or the data set cannot be read.
    pub async fn ask_all(
        &self,
        kind: &DatasetSpec,
        given: &[String],
        mut on_answer: impl FnMut(&Asked),
    ) -> Result<Vec<Asked>> {
        let views = self.views().await?;
        let mut asked = Vec::new();
        for (text, view) in self.plans(kind, given, &views)? {
            let view = match view {
                Some(view) => view,
                None => self.most_relevant(&text, &views).await?,
            };
            let one = self.ask(text, view).await?;
            on_answer(&one);
            asked.push(one);
        }
        Ok(asked)
    }

    /// The keyframes with language.
    async fn views(&self) -> Result<Vec<View>> {
        let frames = self.client.frames(self.map).await?;
        let position = |sequence| {
            (0..self.dataset.len()).find(|index| self.dataset.sequence(*index) == sequence)
        };
        let known = frames.iter().filter(|frame| frame.has_language);
        let views: Vec<View> = known
            .filter_map(|frame| {
                let sequence = frame.sequence;
                position(sequence).map(|index| View { index, sequence })
            })
            .collect();
        if views.is_empty() {
            bail!("map {}: none of {} keyframes has language", self.map, frames.len());
        }
        Ok(views)
    }

    fn plans(&self, kind: &DatasetSpec, given: &[String], views: &[View]) -> Result<Vec<Plan>> {
        let Some(truth) = self.dataset.truth() else {
            let words = if given.is_empty() { questions::usual(kind) } else { given.to_vec() };
            return Ok(words.into_iter().map(|text| (text, None)).collect());
        };
        let sights = sights(truth, views)?;
        let view = |sight: &Sight| views.iter().copied().find(|view| view.index == sight.index);
        if given.is_empty() {
            let chosen = questions::choose(sights, &truth.classes());
            return Ok(chosen
                .into_iter()
                .map(|sight| (sight.class.clone(), view(&sight)))
                .collect());
        }
        let plan = |text: &String| {
            let sight = sights.iter().find(|sight| sight.class == *text);
            (text.clone(), sight.and_then(view))
        };
        Ok(given.iter().map(plan).collect())
    }

    /// The view with the highest peak, among a few.
    async fn most_relevant(&self, text: &str, views: &[View]) -> Result<View> {
        let mut best: Option<(f32, View)> = None;
        for view in questions::spread(views) {
            let answer =
                self.client.query(self.map, &Question::in_frame(text, view.sequence)).await?;
            let score = answer.peak.map_or(0.0, |peak| peak.score);
            if best.is_none_or(|(known, _)| score > known) {
                best = Some((score, view));
            }
        }
        best.map(|(_, view)| view).context("there are no views")
    }

    async fn ask(&self, text: String, view: View) -> Result<Asked> {
        let started = Instant::now();
        let seen = self.client.query(self.map, &Question::in_frame(&text, view.sequence)).await?;
        let milliseconds = started.elapsed().as_secs_f64() * 1e3;
        let link = seen.heatmap.as_ref().context("the server's answer has no heat map")?;
        let (relevancy, npy) = self.client.heatmap(link).await?;
        let space = self.client.query(self.map, &Question::in_space(&text)).await?;
        let verdict = match self.dataset.truth() {
            Some(truth) => judge(truth, &text, view, &seen, &space)?,
            None => None,
        };
        Ok(Asked { text, view, seen, relevancy, npy, space, milliseconds, verdict })
    }
}

fn sights(truth: &dyn Truth, views: &[View]) -> Result<Vec<Sight>> {
    let mut sights = Vec::new();
    for view in views {
        let mask = truth.mask(view.index)?;
        questions::look(&mut sights, truth.instances(), view.index, &mask);
    }
    Ok(sights)
}

fn judge(
    truth: &dyn Truth,
    class: &str,
    view: View,
    seen: &Answer,
    space: &Answer,
) -> Result<Option<Verdict>> {
    let things: Vec<&Instance> =
        truth.instances().iter().filter(|instance| instance.class == class).collect();
    if things.is_empty() {
        return Ok(None);
    }
    let mask = truth.mask(view.index)?;
    let center = best_object(space).map(|object| object.center.map(f64::from));
    Ok(Some(Verdict {
        peak_inside: seen.peak.is_some_and(|peak| is_on(&things, &mask, peak)),
        center_inside: center.is_some_and(|center| is_in(&things, center)),
    }))
}

/// Whether a pixel shows one of the objects.
fn is_on(things: &[&Instance], mask: &Mask, peak: Peak) -> bool {
    let inside = |at: f32, side: u32| (-0.5..side as f32 - 0.5).contains(&at);
    if !inside(peak.x, mask.width) || !inside(peak.y, mask.height) {
        return false;
    }
    let (x, y) = (peak.x.round() as usize, peak.y.round() as usize);
    let id = mask.ids[y * mask.width as usize + x];
    things.iter().any(|thing| thing.id == id)
}

/// Whether a point of the world is in the box of one of the objects, within the tolerance.
fn is_in(things: &[&Instance], point: [f64; 3]) -> bool {
    things.iter().any(|thing| {
        (0..3).all(|axis| {
            let low = thing.aabb_min[axis] - BOX_MARGIN_METRES;
            let high = thing.aabb_max[axis] + BOX_MARGIN_METRES;
            (low..=high).contains(&point[axis])
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instance(id: u16, class: &str, aabb_min: [f64; 3], aabb_max: [f64; 3]) -> Instance {
        Instance { id, name: format!("{class}_{id}"), class: class.into(), aabb_min, aabb_max }
    }

    #[test]
    fn the_peak_must_be_on_the_object() {
        let chair = instance(2, "chair", [0.0; 3], [1.0; 3]);
        let mask = Mask { width: 3, height: 2, ids: vec![0, 1, 2, 2, 0, 1] };
        let on = |x: f32, y: f32| is_on(&[&chair], &mask, Peak { x, y, score: 1.0 });
        assert!(on(2.0, 0.0) && on(0.0, 1.0) && on(-0.4, 1.3));
        assert!(!on(0.0, 0.0), "nothing");
        assert!(!on(1.0, 0.0), "another thing");
        assert!(!on(3.0, 0.0) && !on(0.0, -1.0) && !on(f32::NAN, 0.0), "outside");
    }

    #[test]
    fn the_centre_may_be_within_the_tolerance_of_the_box() {
        let near = instance(1, "cup", [0.0; 3], [1.0; 3]);
        let far = instance(2, "cup", [5.0; 3], [6.0; 3]);
        assert!(is_in(&[&near, &far], [5.5; 3]));
        assert!(is_in(&[&near], [0.5, -0.09, 1.09]));
        assert!(!is_in(&[&near], [0.5, -0.11, 0.5]));
        assert!(!is_in(&[&near], [5.5; 3]));
        assert!(!is_in(&[], [0.5; 3]));
    }
}
