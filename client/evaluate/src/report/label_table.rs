//! The table of labels: scores of each, and whether the map says that it is there.

use crate::language::{ClassScore, LabelMeans, Language, MaskMeans};
use crate::presence::Presence;
use crate::table::Column;

/// A row for each label. Columns that no label has a value for are left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LabelTable {
    names: Vec<String>,
    /// Cells in the order of the columns.
    pub rows: Vec<Vec<String>>,
}

impl LabelTable {
    /// The heading: the first column is of words, the others are of numbers.
    pub fn columns(&self) -> Vec<Column<'_>> {
        let names = self.names.iter().map(String::as_str).enumerate();
        names
            .map(|(at, name)| if at == 0 { Column::left(name) } else { Column::right(name) })
            .collect()
    }
}

/// The table of a report; a brief one for narrow screens has fewer columns and no means.
pub fn label_table(language: &Language, presence: Option<&Presence>, is_brief: bool) -> LabelTable {
    let at_bundle = format!("IoU at {:.2}", language.bundle_threshold);
    // Name, whether it is in the brief table, and the number of decimals.
    let columns = [
        ("label", true, 0),
        ("frames", true, 0),
        ("share", true, 3),
        ("IoU at 0.5", true, 3),
        (&at_bundle, true, 3),
        ("IoU released", false, 3),
        ("IoU argmax", false, 3),
        ("Loc box", true, 2),
        ("Loc synonyms", true, 2),
        ("Loc object", false, 2),
        ("AP", true, 3),
        ("present", true, 0),
    ];
    let row = |label: &str, frames: usize, means: &LabelMeans, present: Option<bool>| {
        let scores = numbers(means).into_iter().zip(&columns[2..]);
        let scores =
            scores.map(|(value, (.., digits))| value.map(|value| format!("{value:.digits$}")));
        let present = present.map(|present| if present { "yes" } else { "no" }.to_owned());
        let first = [Some(label.to_owned()), Some(frames.to_string())];
        first.into_iter().chain(scores).chain([present]).collect::<Vec<_>>()
    };
    let mut cells: Vec<Vec<Option<String>>> = language
        .classes
        .iter()
        .map(|ClassScore { label, query, frames, means }| {
            row(label, *frames, means, presence.and_then(|presence| presence.of_label(query)))
        })
        .collect();
    if !is_brief {
        let frames = language.test_frames.len();
        cells.push(row("**mean over frames**", frames, &language.scene, None));
    }
    let is_wanted =
        |at: &usize| cells.iter().any(|row| row[*at].is_some()) && (columns[*at].1 || !is_brief);
    let wanted: Vec<usize> = (0..columns.len()).filter(is_wanted).collect();
    let rows = cells
        .iter()
        .map(|row| wanted.iter().map(|at| row[*at].clone().unwrap_or_default()).collect());
    LabelTable {
        names: wanted.iter().map(|at| columns[*at].0.to_owned()).collect(),
        rows: rows.collect(),
    }
}

/// The numbers of a row, in the order of the columns.
fn numbers(means: &LabelMeans) -> [Option<f64>; 9] {
    let of = |value: fn(&MaskMeans) -> f64| means.masks.as_ref().map(value);
    [
        of(|masks| masks.share),
        of(|masks| masks.miou_paper),
        of(|masks| masks.miou_bundle),
        of(|masks| masks.miou_released),
        of(|masks| masks.miou_argmax),
        Some(means.loc_box),
        means.loc_synonyms,
        of(|masks| masks.loc_mask),
        of(|masks| masks.average_precision),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::example::example_report;

    #[test]
    fn columns_without_values_are_left_out() {
        let report = example_report();
        let (mut language, presence) = (report.language.unwrap(), report.presence.unwrap());
        let table = label_table(&language, Some(&presence), true);
        assert_eq!(
            table.names,
            ["label", "frames", "share", "IoU at 0.5", "IoU at 0.87", "Loc box", "AP", "present"]
        );
        assert_eq!(table.rows, [["sofa", "2", "0.060", "0.210", "0.440", "0.91", "0.600", "yes"]]);
        for means in [&mut language.scene, &mut language.classes[0].means] {
            *means = LabelMeans { loc_synonyms: Some(0.5), masks: None, ..*means };
        }
        let table = label_table(&language, None, false);
        assert_eq!(table.names, ["label", "frames", "Loc box", "Loc synonyms"]);
        assert_eq!(table.rows[0], ["sofa", "2", "0.91", "0.50"]);
        assert_eq!((table.rows.len(), table.columns().len()), (2, 4));
    }
}
