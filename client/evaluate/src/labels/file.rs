//! A file of labels, for data sets without masks:
//!
//! ```json
//! {
//!   "queries": [{"label": "sofa", "query": "sofa", "synonyms": ["couch"]}],
//!   "frames": [{
//!     "frame": 33,
//!     "objects": [{
//!       "label": "sofa",
//!       "boxes": [[173, 130, 139, 155]],
//!       "rle": {"size": [360, 540], "counts": [61735, 42, 132623]}
//!     }],
//!     "ignore_labels": []
//!   }],
//!   "absent": ["piano"]
//! }
//! ```
//!
//! `frame` is the number of a frame of the data set. `boxes` are `[x, y, width, height]` in its pixels.
//! `rle` is a mask in COCO's run lengths (not compressed): column by column, zeros first; `size` is
//! `[height, width]`. One of both suffices: without a mask only peaks are scored, without boxes they
//! are those of the mask's regions. Labels in `ignore_labels` do not count in this frame. A label that
//! a frame does not list may be there or not: it is not judged in this frame. `synonyms`,
//! `ignore_labels` and `absent` may be missing.

use super::label::{Label, Labels, Place, Sight, Sights, TEST_FRAMES};
use crate::error::EvaluateError;
use crate::score::Bounds;
use crate::statistics::spread;
use lexsplat_client::dataset::Dataset;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A file of labels that fits a data set.
#[derive(Clone, Debug)]
pub struct LabelFile {
    path: PathBuf,
    labels: Vec<Label>,
    /// What each frame shows of each label, by the frame's number.
    frames: BTreeMap<u64, Vec<Sight>>,
    absent: Vec<String>,
}

/// Why a file of labels cannot be used.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct LabelFileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub reason: String,
}

/// The file as it is written.
#[derive(Deserialize)]
struct Written {
    queries: Vec<WrittenLabel>,
    frames: Vec<WrittenFrame>,
    #[serde(default)]
    absent: Vec<String>,
}

#[derive(Deserialize)]
struct WrittenLabel {
    label: String,
    query: String,
    #[serde(default)]
    synonyms: Vec<String>,
}

#[derive(Deserialize)]
struct WrittenFrame {
    frame: u64,
    objects: Vec<WrittenObject>,
    #[serde(default)]
    ignore_labels: Vec<String>,
}

#[derive(Deserialize)]
struct WrittenObject {
    label: String,
    #[serde(default)]
    boxes: Vec<[f64; 4]>,
    rle: Option<RunLengths>,
}

#[derive(Deserialize)]
struct RunLengths {
    size: [usize; 2],
    counts: Vec<usize>,
}

impl LabelFile {
    /// Reads a file whose frames are of this data set.
    ///
    /// # Errors
    /// [`LabelFileError`] if it is no such file, or if one of its labels, frames, boxes or masks cannot
    /// be right.
    pub fn read(path: &Path, dataset: &dyn Dataset) -> Result<Self, LabelFileError> {
        let error = |reason| LabelFileError { path: path.into(), reason };
        let text = std::fs::read(path).map_err(|reason| error(format!("cannot read: {reason}")))?;
        let written: Written = serde_json::from_slice(&text)
            .map_err(|reason| error(format!("not a file of labels: {reason}")))?;
        let camera = dataset.intrinsics();
        let numbers = (0..dataset.len()).map(|index| dataset.sequence(index)).collect();
        let size = [camera.width as usize, camera.height as usize];
        let (labels, frames) = checked(&written, size, &numbers).map_err(error)?;
        Ok(Self { path: path.into(), labels, frames, absent: written.absent })
    }

    /// Its labels, and what its frames among the tracked ones show.
    pub(super) fn labels<'a>(
        &'a self,
        dataset: &'a dyn Dataset,
        tracked: &[usize],
    ) -> Result<Labels<'a>, EvaluateError> {
        let is_labelled = |index: &usize| self.frames.contains_key(&dataset.sequence(*index));
        let frames: Vec<usize> = tracked.iter().copied().filter(is_labelled).collect();
        if frames.is_empty() {
            return Err(EvaluateError::NothingLabelled { labelled: self.frames.len() });
        }
        let frames = spread(&frames, TEST_FRAMES);
        let is_shown = |at: &usize| {
            let mut sights =
                frames.iter().map(|index| &self.frames[&dataset.sequence(*index)][*at]);
            sights.any(|sight| matches!(sight, Sight::Shown(_)))
        };
        let shown: Vec<usize> = (0..self.labels.len()).filter(is_shown).collect();
        let name = self.path.file_name().unwrap_or(self.path.as_os_str());
        Ok(Labels {
            labels: shown.iter().map(|at| self.labels[*at].clone()).collect(),
            frames,
            absent: self.absent.clone(),
            file: Some(name.to_string_lossy().into_owned()),
            masks: None,
            sights: Box::new(Boxes { file: self, dataset, shown }),
        })
    }
}

/// What the frames of a file show of some of its labels.
struct Boxes<'a> {
    file: &'a LabelFile,
    dataset: &'a dyn Dataset,
    /// Places of the labels in the file.
    shown: Vec<usize>,
}

impl Sights for Boxes<'_> {
    fn of(&self, frame: usize) -> Result<Vec<Sight>, EvaluateError> {
        let sights = &self.file.frames[&self.dataset.sequence(frame)];
        Ok(self.shown.iter().map(|at| sights[*at].clone()).collect())
    }
}

type Checked = (Vec<Label>, BTreeMap<u64, Vec<Sight>>);

/// Labels and frames of a file, for pictures of `[columns, rows]` with these numbers.
fn checked(
    written: &Written,
    size: [usize; 2],
    numbers: &BTreeSet<u64>,
) -> Result<Checked, String> {
    let mut labels: Vec<Label> = Vec::new();
    for WrittenLabel { label, query, synonyms } in &written.queries {
        if labels.iter().any(|other| other.name == *label) {
            return Err(format!("queries: {label:?} is there twice"));
        }
        if [query].into_iter().chain(synonyms).any(|text| text.trim().is_empty()) {
            return Err(format!("queries: {label:?} has an empty text"));
        }
        let (name, query, synonyms) = (label.clone(), query.clone(), synonyms.clone());
        labels.push(Label { name, query, synonyms });
    }
    let mut frames = BTreeMap::new();
    for frame in &written.frames {
        let number = frame.frame;
        let failed = |reason: String| format!("frame {number}: {reason}");
        if !numbers.contains(&number) {
            return Err(failed("the data set has no frame of this number".into()));
        }
        if frames.insert(number, sights(frame, &labels, size).map_err(failed)?).is_some() {
            return Err(failed("it is there twice".into()));
        }
    }
    Ok((labels, frames))
}

/// What a frame shows of each label.
fn sights(frame: &WrittenFrame, labels: &[Label], size: [usize; 2]) -> Result<Vec<Sight>, String> {
    let named = frame.objects.iter().map(|object| &object.label).chain(&frame.ignore_labels);
    for name in named {
        if !labels.iter().any(|label| label.name == *name) {
            return Err(format!("label {name:?} is not among the queries"));
        }
    }
    let mut sights = Vec::with_capacity(labels.len());
    for Label { name, .. } in labels {
        let own = frame.objects.iter().filter(|object| object.label == *name);
        let sight = sight(own, size).map_err(|reason| format!("{name:?}: {reason}"))?;
        let is_ignored = frame.ignore_labels.contains(name);
        sights.push(if is_ignored { Sight::Unclear } else { sight });
    }
    Ok(sights)
}

/// What a frame shows of the label of these objects.
fn sight<'a>(
    objects: impl Iterator<Item = &'a WrittenObject>,
    size: [usize; 2],
) -> Result<Sight, String> {
    let (mut bounds, mut masks, mut has_all_masks) = (Vec::new(), None::<Vec<bool>>, true);
    for object in objects {
        for sides in &object.boxes {
            bounds.push(pixels(*sides, size)?);
        }
        match &object.rle {
            Some(rle) => {
                let mask = rle.mask(size)?;
                masks = Some(match masks.take() {
                    Some(other) => other.iter().zip(&mask).map(|(a, b)| *a || *b).collect(),
                    None => mask,
                });
            }
            None if object.boxes.is_empty() => {
                return Err("expected boxes or rle, found neither".into());
            }
            None => has_all_masks = false,
        }
    }
    Ok(match masks.filter(|_| has_all_masks).map(|mask| Sight::of_mask(mask, size[0])) {
        Some(Sight::Shown(Place { mask, .. })) if !bounds.is_empty() => {
            Sight::Shown(Place { boxes: bounds, mask })
        }
        Some(Sight::Shown(place)) => Sight::Shown(place),
        // A label that a frame does not list may be there all the same.
        Some(_) => Sight::Unclear,
        None if bounds.is_empty() => Sight::Unclear,
        None => Sight::Shown(Place { boxes: bounds, mask: None }),
    })
}

/// The pixels of a box `[x, y, width, height]`.
fn pixels([x, y, width, height]: [f64; 4], [columns, rows]: [usize; 2]) -> Result<Bounds, String> {
    let (right, bottom) = (x + width, y + height);
    let is_inside = x >= 0.0 && y >= 0.0 && right <= columns as f64 && bottom <= rows as f64;
    if !is_inside || width <= 0.0 || height <= 0.0 {
        return Err(format!(
            "expected a box [x, y, width, height] inside the picture of {columns}x{rows} pixels, \
             found [{x}, {y}, {width}, {height}]"
        ));
    }
    let range = |start: f64, end: f64| [start.floor() as usize, end.ceil() as usize - 1];
    Ok(Bounds { columns: range(x, right), rows: range(y, bottom) })
}

impl RunLengths {
    /// The pixels `[rows * columns]`, row by row.
    fn mask(&self, [columns, rows]: [usize; 2]) -> Result<Vec<bool>, String> {
        let Self { size: [height, width], counts } = self;
        if [*width, *height] != [columns, rows] {
            return Err(format!(
                "rle: expected size [{rows}, {columns}] as the picture has, found [{height}, {width}]"
            ));
        }
        let all = counts.iter().try_fold(0_usize, |sum, count| sum.checked_add(*count));
        if all != Some(rows * columns) {
            let found = all.map_or_else(|| "more".into(), |all| all.to_string());
            return Err(format!(
                "rle: expected counts for {} pixels, found {found}",
                rows * columns
            ));
        }
        let mut mask = vec![false; rows * columns];
        let mut at = 0;
        for (run, count) in counts.iter().enumerate() {
            if run % 2 == 1 {
                (at..at + count).for_each(|at| mask[at % rows * columns + at / rows] = true);
            }
            at += count;
        }
        Ok(mask)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [20, 10];

    /// A file with frames 3 and 5 in the data set, pictures of 20x10 pixels.
    fn read(objects: &str) -> Result<Checked, String> {
        let text = format!(
            r#"{{"queries": [{{"label": "sofa", "query": "the sofa", "synonyms": ["couch"]}},
                             {{"label": "lamp", "query": "lamp"}}],
                 "frames": [{{"frame": 5, {objects}}}], "absent": ["piano"]}}"#
        );
        let written: Written = serde_json::from_str(&text).map_err(|error| error.to_string())?;
        checked(&written, SIZE, &[3, 5].into())
    }

    #[test]
    fn boxes_and_masks_are_read() {
        let (labels, frames) =
            read(r#""objects": [{"label": "sofa", "boxes": [[2, 1, 3, 4]]}]"#).unwrap();
        assert_eq!((labels[0].query.as_str(), labels[0].synonyms.len()), ("the sofa", 1));
        let bounds = Bounds { columns: [2, 4], rows: [1, 4] };
        // A label that is not listed may be there or not.
        let expected = [Sight::Shown(Place { boxes: vec![bounds], mask: None }), Sight::Unclear];
        assert_eq!(frames[&5], expected);
        // The columns 3 to 9, of 10 pixels each.
        let rle =
            r#""objects": [{"label": "lamp", "rle": {"size": [10, 20], "counts": [30, 70, 100]}}]"#;
        let Sight::Shown(place) = &read(rle).unwrap().1[&5][1] else { panic!("it is shown") };
        assert_eq!(place.boxes, [Bounds { columns: [3, 9], rows: [0, 9] }]);
        let mask = place.mask.as_ref().unwrap();
        assert!(mask[9 * 20 + 3] && !mask[9 * 20 + 2] && mask[9] && !mask[10]);
        // Boxes of the file come before those of the mask. A label that is ignored is not judged.
        let both = rle.replace(r#""rle""#, r#""boxes": [[0.5, 0, 19.2, 1]], "rle""#);
        let Sight::Shown(place) = &read(&both).unwrap().1[&5][1] else { panic!("it is shown") };
        assert_eq!(place.boxes, [Bounds { columns: [0, 19], rows: [0, 0] }]);
        let ignored = format!(r#"{both}, "ignore_labels": ["lamp"]"#);
        assert_eq!(read(&ignored).unwrap().1[&5][1], Sight::Unclear);
    }

    #[test]
    fn a_mask_of_some_objects_is_no_mask_of_the_label() {
        let rle = r#"{"label": "lamp", "rle": {"size": [10, 20], "counts": [30, 70, 100]}}"#;
        let boxed = r#"{"label": "lamp", "boxes": [[15, 0, 2, 2]]}"#;
        let sight = |objects: &str| {
            let Sight::Shown(place) =
                read(&format!(r#""objects": [{objects}]"#)).unwrap().1[&5][1].clone()
            else {
                panic!("it is shown")
            };
            place
        };
        assert_eq!(sight(&format!("{rle}, {boxed}")).mask, None);
        let other = rle.replace("[30, 70, 100]", "[120, 80]");
        let two = sight(&format!("{rle}, {other}"));
        assert_eq!(
            (two.boxes.len(), two.mask.map(|mask| mask.iter().filter(|is| **is).count())),
            (2, Some(150))
        );
    }

    #[test]
    fn what_cannot_be_right_is_refused() {
        for (objects, expected) in [
            (r#""objects": [{"label": "sofa"}]"#, "frame 5: \"sofa\": expected boxes or rle"),
            (
                r#""objects": [{"label": "sofas", "boxes": [[0, 0, 1, 1]]}]"#,
                "frame 5: label \"sofas\" is not",
            ),
            (r#""objects": [], "ignore_labels": ["bed"]"#, "frame 5: label \"bed\" is not among"),
            (
                r#""objects": [{"label": "sofa", "boxes": [[18, 0, 3, 2]]}]"#,
                "picture of 20x10 pixels, found [18, 0, 3, 2]",
            ),
            (r#""objects": [{"label": "sofa", "boxes": [[-1, 0, 3, 2]]}]"#, "inside the picture"),
            (r#""objects": [{"label": "sofa", "boxes": [[1, 1, 0, 2]]}]"#, "inside the picture"),
            (
                r#""objects": [{"label": "sofa", "rle": {"size": [20, 10], "counts": [200]}}]"#,
                "expected size [10, 20]",
            ),
            (
                r#""objects": [{"label": "sofa", "rle": {"size": [10, 20], "counts": [30, 60]}}]"#,
                "counts for 200 pixels, found 90",
            ),
            (r#""objects": []}, {"frame": 4, "objects": []"#, "frame 4: the data set has no frame"),
            (r#""objects": []}, {"frame": 5, "objects": []"#, "frame 5: it is there twice"),
            (r#""things": []"#, "missing field `objects`"),
        ] {
            let error = read(objects).unwrap_err();
            assert!(error.contains(expected), "{objects}: {error}");
        }
        let labels = |queries: &str| {
            let text = format!(r#"{{"queries": [{queries}], "frames": []}}"#);
            checked(&serde_json::from_str(&text).unwrap(), SIZE, &BTreeSet::new())
                .map(|found| found.0.len())
        };
        let sofa = r#"{"label": "sofa", "query": "sofa"}"#;
        assert_eq!(labels(sofa), Ok(1));
        assert_eq!(
            labels(&format!("{sofa}, {sofa}")),
            Err("queries: \"sofa\" is there twice".into())
        );
        let empty = sofa.replace(r#""query": "sofa""#, r#""query": " ""#);
        assert_eq!(labels(&empty), Err("queries: \"sofa\" has an empty text".into()));
    }
}
