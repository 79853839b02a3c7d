//! Tables for people: as text, and as Markdown.

use comfy_table::presets::{ASCII_MARKDOWN, NOTHING};
use comfy_table::{CellAlignment, Table};

/// A column of a table.
#[derive(Clone, Copy, Debug)]
pub struct Column<'a> {
    name: &'a str,
    alignment: CellAlignment,
}

impl<'a> Column<'a> {
    /// A column of words.
    pub fn left(name: &'a str) -> Self {
        Self { name, alignment: CellAlignment::Left }
    }

    /// A column of numbers.
    pub fn right(name: &'a str) -> Self {
        Self { name, alignment: CellAlignment::Right }
    }
}

/// A table as text: columns two spaces apart, with a heading. It ends with a line feed.
///
/// # Panics
/// If a row has not one cell for each column.
pub fn table(columns: &[Column<'_>], rows: &[Vec<String>]) -> String {
    let mut table = filled(columns, rows);
    table.load_style(NOTHING);
    table.column_iter_mut().for_each(|column| {
        column.set_padding((0, 2));
    });
    table.trim_fmt() + "\n"
}

/// A table as Markdown. It ends with a line feed.
///
/// # Panics
/// If a row has not one cell for each column.
pub fn markdown_table(columns: &[Column<'_>], rows: &[Vec<String>]) -> String {
    let mut table = filled(columns, rows);
    table.load_style(ASCII_MARKDOWN);
    table.trim_fmt() + "\n"
}

fn filled(columns: &[Column<'_>], rows: &[Vec<String>]) -> Table {
    let mut table = Table::new();
    table.set_header(columns.iter().map(|column| column.name));
    for row in rows {
        assert_eq!(row.len(), columns.len(), "table: cells against columns");
        table.add_row(row);
    }
    for (shown, column) in table.column_iter_mut().zip(columns) {
        shown.set_cell_alignment(column.alignment);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> ([Column<'static>; 2], [Vec<String>; 2]) {
        let rows = [["sofa", "7"], ["potted plant", "1234"]].map(|row| row.map(Into::into).into());
        ([Column::left("what"), Column::right("n")], rows)
    }

    #[test]
    fn words_are_aligned_left_and_numbers_right() {
        let (columns, rows) = example();
        let text = table(&columns, &rows);
        assert_eq!(text, "what             n\nsofa             7\npotted plant  1234\n");
        let text = table(&columns, &[vec!["  table".into(), "–".into()]]);
        assert_eq!(text, "what     n\n  table  –\n", "indentation is kept");
    }

    #[test]
    fn markdown_has_a_line_below_the_heading() {
        let (columns, rows) = example();
        let lines = [
            "| what         |    n |",
            "|--------------|------|",
            "| sofa         |    7 |",
            "| potted plant | 1234 |\n",
        ];
        assert_eq!(markdown_table(&columns, &rows), lines.join("\n"));
    }

    #[test]
    #[should_panic(expected = "cells against columns")]
    fn a_missing_cell_is_a_mistake() {
        table(&[Column::left("a"), Column::left("b")], &[vec!["1".into()]]);
    }
}
