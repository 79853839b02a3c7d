//! Tables for people: columns as wide as their longest cell, two spaces apart.

/// Where a column's cells stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// Words.
    Left,
    /// Numbers.
    Right,
}

/// A table with a heading; as text that ends with a line feed.
///
/// # Panics
/// If a row has not one cell for each column.
pub fn table(columns: &[(&str, Align)], rows: &[Vec<String>]) -> String {
    let heading: Vec<String> = columns.iter().map(|(name, _)| (*name).to_owned()).collect();
    let mut widths: Vec<usize> = heading.iter().map(|cell| cell.chars().count()).collect();
    for row in rows {
        assert_eq!(row.len(), columns.len(), "table: cells against columns");
        for (width, cell) in widths.iter_mut().zip(row) {
            *width = (*width).max(cell.chars().count());
        }
    }
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(columns).zip(&widths);
        let cells = cells.map(|((cell, (_, align)), width)| match align {
            Align::Left => format!("{cell:<width$}"),
            Align::Right => format!("{cell:>width$}"),
        });
        let cells: Vec<String> = cells.collect();
        format!("{}\n", cells.join("  ").trim_end())
    };
    std::iter::once(&heading).chain(rows).map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_stand_left_and_numbers_right() {
        let rows =
            vec![vec!["sofa".into(), "7".into()], vec!["potted plant".into(), "1234".into()]];
        let text = table(&[("what", Align::Left), ("n", Align::Right)], &rows);
        assert_eq!(text, "what             n\nsofa             7\npotted plant  1234\n");
    }

    #[test]
    #[should_panic(expected = "cells against columns")]
    fn a_missing_cell_is_a_mistake() {
        table(&[("a", Align::Left), ("b", Align::Left)], &[vec!["1".into()]]);
    }
}
