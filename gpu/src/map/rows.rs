//! Conversion between flat values and rows of four, as the device stores them.

use crate::shader::layout::{Row, rows_for};

/// Pads each group of `channels` values with zeros to whole rows.
pub fn pad_rows(values: &[f32], channels: usize) -> Vec<Row> {
    let mut rows = Vec::with_capacity(values.len() / channels.max(1) * rows_for(channels));
    for element in values.chunks(channels.max(1)) {
        rows.extend(element.chunks(4).map(|part| {
            let mut row = [0.0; 4];
            row[..part.len()].copy_from_slice(part);
            row
        }));
    }
    rows
}

/// Undoes [`pad_rows`].
pub fn unpad_rows(rows: &[Row], channels: usize) -> Vec<f32> {
    rows.chunks(rows_for(channels).max(1))
        .flat_map(|element| element.iter().flatten().take(channels).copied())
        .collect()
}
