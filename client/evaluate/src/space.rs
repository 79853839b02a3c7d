//! Queries about the whole map, scored in 3D: the protocol of the paper (§5, "3D localisation").
//!
//! Truth is the labelled pixels of every fifth frame with measured depth, back-projected with the
//! true poses, in voxels of 2 cm. Found are the points of the 3D answer, moved by the rigid
//! alignment of the trajectory. Scored are Chamfer and earth mover's distance of each label, means
//! over labels, and the same without failures (farther than mean + 2 standard deviations, as in the
//! paper). Also counted are the objects of a class in the answer and in the frames.

use crate::clouds::{Point, Voxels, chamfer, earth_movers, resampled};
use crate::context::Context;
use crate::error::EvaluateError;
use crate::labels::COUNTED_EVERY;
use crate::presence::Judgement;
use crate::statistics::mean;
use crate::step::Step;
use lexsplat_client::dataset::{Dataset, Intrinsics, Truth};
use lexsplat_client::http::{Answer, Question};
use nalgebra::{Isometry3, Point3};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Side of the truth's voxels, metres.
pub const VOXEL_METRES: f64 = 0.02;
/// Points of each cloud that are paired for the earth mover's distance.
pub const PAIRED: usize = 1024;
/// An object counts if some frame shows it with so many pixels.
pub const SEEN_PIXELS: usize = 400;
/// Most objects in an answer.
const MOST_OBJECTS: u32 = 64;

/// The 3D score of a label.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpaceScore {
    /// The class; its name is the query.
    pub label: String,
    /// Number of points in the answer.
    pub points: usize,
    /// Number of voxels of the label.
    pub truth_voxels: usize,
    /// Mean distance of the answer's points to the truth, metres; absent without an answer.
    pub found_to_truth_m: Option<f64>,
    /// Mean distance of the truth to the answer's points, metres.
    pub truth_to_found_m: Option<f64>,
    /// Chamfer distance: the sum of both, metres.
    pub chamfer_m: Option<f64>,
    /// Earth mover's distance of samples of both, metres.
    pub emd_m: Option<f64>,
}

/// Objects of a class.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct CountScore {
    /// The class.
    pub class: String,
    /// Number of objects in the frames.
    pub there: usize,
    /// Number of objects in the answer.
    pub found: usize,
}

/// Means over labels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SpaceMeans {
    /// Mean Chamfer distance over labels with an answer, metres.
    pub chamfer_m: Option<f64>,
    /// Mean earth mover's distance over labels with an answer, metres.
    pub emd_m: Option<f64>,
    /// Mean Chamfer distance without failures, metres.
    pub chamfer_without_failures_m: Option<f64>,
    /// Number of Chamfer failures.
    pub chamfer_failures: usize,
    /// Mean earth mover's distance without failures, metres.
    pub emd_without_failures_m: Option<f64>,
    /// Number of failures of the earth mover's distance.
    pub emd_failures: usize,
    /// Number of labels without an answer, which have no distance.
    pub unanswered: usize,
}

/// Scores of queries about the whole map.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Space {
    /// Relevancy threshold of the points.
    pub threshold: f32,
    /// Means over labels.
    #[serde(flatten)]
    pub means: SpaceMeans,
    /// Score of each label.
    pub labels: Vec<SpaceScore>,
    /// Counts of each class; walls, floor and ceiling are left out.
    pub counts: Vec<CountScore>,
    /// Share of the classes with a count that is off by at most one.
    pub counted_within_one: Option<f64>,
}

/// The objects that the frames show.
pub struct Shown {
    /// Voxel means of each class that is asked for.
    clouds: HashMap<String, Vec<Point>>,
    /// Number of objects of each class.
    things: BTreeMap<String, usize>,
}

impl Shown {
    /// Reads every fifth frame of the data set.
    pub fn of(
        dataset: &dyn Dataset,
        truth: &dyn Truth,
        classes: &[String],
    ) -> Result<Self, EvaluateError> {
        let asked: BTreeSet<&str> = classes.iter().map(String::as_str).collect();
        let class_of: HashMap<u16, &str> =
            truth.instances().iter().map(|thing| (thing.id, thing.class.as_str())).collect();
        let mut voxels: HashMap<&str, Voxels> = HashMap::new();
        let mut most_pixels: HashMap<u16, usize> = HashMap::new();
        let camera = dataset.intrinsics();
        for index in (0..dataset.len()).step_by(COUNTED_EVERY) {
            let frame = dataset.clean_frame(index)?;
            let Some(world_from_camera) = frame.world_from_camera else { continue };
            let depth = frame.depth_metres(dataset.depth_unit_metres())?;
            let mask = truth.mask(index)?;
            let mut pixels: HashMap<u16, usize> = HashMap::new();
            for (at, (id, metres)) in mask.ids.iter().zip(&depth).enumerate() {
                let Some(class) = class_of.get(id) else { continue };
                *pixels.entry(*id).or_default() += 1;
                if *metres > 0.0 && asked.contains(class) {
                    let point = back_projected(&camera, at, f64::from(*metres));
                    let point = (world_from_camera * Point3::from(point)).into();
                    let cloud = voxels.entry(*class).or_insert_with(|| Voxels::new(VOXEL_METRES));
                    cloud.add(point);
                }
            }
            for (id, pixels) in pixels {
                let most = most_pixels.entry(id).or_default();
                *most = pixels.max(*most);
            }
        }
        let own = truth.classes();
        let mut things: BTreeMap<String, usize> = BTreeMap::new();
        for (id, _) in most_pixels.iter().filter(|(_, pixels)| **pixels >= SEEN_PIXELS) {
            if let Some(class) = own.iter().find(|class| *class == class_of[id]) {
                *things.entry(class.clone()).or_default() += 1;
            }
        }
        let clouds = voxels.into_iter().map(|(class, cloud)| (class.to_owned(), cloud.means()));
        Ok(Self { clouds: clouds.collect(), things })
    }
}

/// The point of a pixel in the camera's frame, metres.
fn back_projected(camera: &Intrinsics, pixel: usize, metres: f64) -> Point {
    let (column, row) = (pixel % camera.width as usize, pixel / camera.width as usize);
    let (x, y) = (column as f64 - camera.cx, row as f64 - camera.cy);
    [x * metres / camera.fx, y * metres / camera.fy, metres]
}

/// Asks for every label and every class of objects in the whole map; also returns judgements of
/// presence.
pub(crate) async fn score(
    context: &Context<'_>,
    truth: &dyn Truth,
    labels: &[String],
    truth_from_map: &Isometry3<f64>,
    on_step: &mut impl FnMut(Step<'_>),
) -> Result<(Space, Vec<Judgement>), EvaluateError> {
    let shown = Shown::of(context.dataset, truth, labels)?;
    let (mut scores, mut judgements, mut threshold) = (Vec::new(), Vec::new(), 0.0);
    for (done, label) in labels.iter().enumerate() {
        on_step(Step::Locating { done, of: labels.len() });
        let answer = ask(context, label).await?;
        threshold = answer.threshold;
        judgements.push(Judgement::in_space(&answer, true));
        let found = points(context, &answer, truth_from_map).await?;
        let cloud = shown.clouds.get(label).map_or(&[][..], Vec::as_slice);
        scores.push(label_score(label, &found, cloud));
    }
    on_step(Step::Locating { done: labels.len(), of: labels.len() });
    let mut counts = Vec::new();
    for (class, &there) in &shown.things {
        let answer = ask(context, class).await?;
        let found = answer.objects.as_ref().map_or(0, Vec::len);
        counts.push(CountScore { class: class.clone(), there, found });
        if !labels.contains(class) {
            judgements.push(Judgement::in_space(&answer, true));
        }
    }
    let within_one =
        counts.iter().map(|count| f64::from(u8::from(count.there.abs_diff(count.found) <= 1)));
    let space = Space {
        threshold,
        means: means(&scores),
        counted_within_one: mean(within_one),
        labels: scores,
        counts,
    };
    Ok((space, judgements))
}

async fn ask(context: &Context<'_>, text: &str) -> Result<Answer, EvaluateError> {
    let question = Question { max_objects: Some(MOST_OBJECTS), ..Question::in_space(text) };
    Ok(context.client.query(context.map, &question).await?)
}

/// The points of an answer, in the data set's world.
async fn points(
    context: &Context<'_>,
    answer: &Answer,
    truth_from_map: &Isometry3<f64>,
) -> Result<Vec<Point>, EvaluateError> {
    let missing = || EvaluateError::Answer { reason: format!("{:?} has no points", answer.text) };
    let array = context.client.points(answer.points.as_ref().ok_or_else(missing)?).await?;
    let moved = |row: &[f32]| {
        let point = Point3::new(row[0], row[1], row[2]).cast::<f64>();
        (truth_from_map * point).into()
    };
    Ok(array.values.chunks_exact(4).map(moved).collect())
}

fn label_score(label: &str, found: &[Point], truth: &[Point]) -> SpaceScore {
    let halves = chamfer(found, truth);
    let emd_m =
        halves.and_then(|_| earth_movers(&resampled(found, PAIRED), &resampled(truth, PAIRED)));
    SpaceScore {
        label: label.to_owned(),
        points: found.len(),
        truth_voxels: truth.len(),
        found_to_truth_m: halves.map(|[there, _]| there),
        truth_to_found_m: halves.map(|[_, back]| back),
        chamfer_m: halves.map(|[there, back]| there + back),
        emd_m,
    }
}

fn means(scores: &[SpaceScore]) -> SpaceMeans {
    let chamfers: Vec<f64> = scores.iter().filter_map(|score| score.chamfer_m).collect();
    let emds: Vec<f64> = scores.iter().filter_map(|score| score.emd_m).collect();
    let (chamfer_without, emd_without) = (successes(&chamfers), successes(&emds));
    SpaceMeans {
        chamfer_m: mean(chamfers.iter().copied()),
        emd_m: mean(emds.iter().copied()),
        chamfer_failures: chamfers.len() - chamfer_without.len(),
        chamfer_without_failures_m: mean(chamfer_without.into_iter()),
        emd_failures: emds.len() - emd_without.len(),
        emd_without_failures_m: mean(emd_without.into_iter()),
        unanswered: scores.len() - chamfers.len(),
    }
}

/// Values up to mean + 2 population standard deviations (paper, supplement).
fn successes(values: &[f64]) -> Vec<f64> {
    let Some(middle) = mean(values.iter().copied()) else { return Vec::new() };
    let variance =
        mean(values.iter().map(|value| (value - middle) * (value - middle))).unwrap_or_default();
    let limit = middle + 2.0 * variance.sqrt();
    values.iter().copied().filter(|value| *value <= limit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lexsplat_client::dataset::FrameRange;
    use lexsplat_synthetic::SyntheticDataset;

    #[test]
    fn failures_are_beyond_two_deviations() {
        let mut values = vec![0.1; 9];
        values.push(3.0);
        // numpy: mean 0.39, std 0.87: the limit is 2.13.
        assert_eq!(successes(&values), [0.1; 9]);
        assert_eq!(successes(&[0.1, 0.2, 0.3]), [0.1, 0.2, 0.3]);
        assert!(successes(&[]).is_empty());
    }

    #[test]
    fn a_label_without_an_answer_has_no_distance_and_is_counted() {
        let cloud: Vec<Point> = (0..9).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        let near: Vec<Point> = cloud.iter().map(|[x, ..]| [*x, 0.1, 0.0]).collect();
        let scores = [label_score("sofa", &near, &cloud), label_score("lamp", &[], &cloud)];
        let means = means(&scores);
        assert!((means.chamfer_m.unwrap() - 0.2).abs() < 1e-9, "{means:?}");
        // 1,024 points of nine: each 113 or 114 times, not always those that belong together.
        let emd = means.emd_m.unwrap();
        assert!((0.0999..0.12).contains(&emd), "{emd}");
        assert_eq!((means.unanswered, means.chamfer_failures), (1, 0));
    }

    #[test]
    fn points_of_frames_lie_in_the_boxes_of_their_objects() {
        let range = FrameRange { end: Some(6), ..FrameRange::default() };
        let dataset = range.of(Box::new(SyntheticDataset::new(3))).unwrap();
        let truth = dataset.truth().unwrap();
        let classes = truth.classes();
        let shown = Shown::of(&*dataset, truth, &classes).unwrap();
        assert!(shown.clouds.len() >= 3 && !shown.things.is_empty(), "{:?}", shown.things);
        for (class, cloud) in &shown.clouds {
            let boxes: Vec<_> =
                truth.instances().iter().filter(|thing| thing.class == *class).collect();
            let near = |point: &Point| {
                boxes.iter().any(|thing| {
                    (0..3).all(|axis| {
                        point[axis] > thing.aabb_min[axis] - 0.05
                            && point[axis] < thing.aabb_max[axis] + 0.05
                    })
                })
            };
            let inside = cloud.iter().filter(|point| near(point)).count();
            assert!(inside as f64 > 0.97 * cloud.len() as f64, "{class}: {inside}");
            // Negative control: two metres away they do not.
            let inside = cloud.iter().filter(|[x, y, z]| near(&[x + 2.0, *y, *z])).count();
            assert!((inside as f64) < 0.9 * cloud.len() as f64, "{class}: {inside}");
        }
        for (class, count) in &shown.things {
            assert!(
                truth.instances().iter().filter(|thing| thing.class == *class).count() >= *count
            );
        }
    }
}
