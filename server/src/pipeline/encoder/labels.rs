//! Language from the labels that come with a frame.
//!
//! In: the [`Labels`] of a frame. Out: a generic code for each label, and the label of each cell of
//! a grid. Each text is embedded and compressed (D -> 32) once. A cell takes the majority label of
//! its pixels, on ties the smallest; this is wrong for the fewest pixels. Label 0, "none", has a
//! code of zeros: no language.

use super::error::LanguageError;
use crate::pipeline::compressor::GENERIC_SIZE;
use crate::pipeline::compressor::generic::GenericEncoder;
use crate::pipeline::frame::Labels;
use crate::pipeline::network::Tensor;
use std::collections::HashMap;
use std::sync::Arc;

/// Embeds a text: `[D]`, unit length, or the reason of a failure.
pub type Embed = Box<dyn FnMut(&str) -> Result<Arc<[f32]>, String> + Send>;

/// Texts in the cache of codes. A full cache is cleared.
const CACHED_TEXTS: usize = 1 << 16;

type Code = [f32; GENERIC_SIZE];

/// Generic codes of texts, with a cache.
pub(super) struct LabelCodes {
    embed: Embed,
    /// Rows and columns of the compressor's input.
    grid: [usize; 2],
    cache: HashMap<String, Code>,
}

impl LabelCodes {
    pub(super) fn new(embed: Embed, grid: [usize; 2]) -> Self {
        Self { embed, grid, cache: HashMap::new() }
    }

    /// The code of each label, `[1 + texts]`. It is zeros for label 0, for labels that no pixel has
    /// and for empty texts.
    pub(super) fn codes(
        &mut self,
        compressor: &mut GenericEncoder,
        labels: &Labels,
    ) -> Result<Vec<Code>, LanguageError> {
        let mut is_present = vec![false; labels.texts.len() + 1];
        labels.ids.iter().for_each(|id| is_present[usize::from(*id)] = true);
        let present = |at: &usize| is_present[at + 1] && !labels.texts[*at].is_empty();
        let present: Vec<usize> = (0..labels.texts.len()).filter(present).collect();
        let unknown: Vec<&str> = present
            .iter()
            .map(|at| labels.texts[*at].as_str())
            .filter(|text| !self.cache.contains_key(*text))
            .collect();
        self.encode(compressor, unknown)?;
        let mut codes = vec![[0.0; GENERIC_SIZE]; is_present.len()];
        for at in present {
            codes[at + 1] = self.cache[&labels.texts[at]];
        }
        Ok(codes)
    }

    /// Embeds and compresses texts into the cache. The compressor processes each cell independently
    /// (paper §4.2), so that one run compresses as many texts as there are cells.
    fn encode(
        &mut self,
        compressor: &mut GenericEncoder,
        mut texts: Vec<&str>,
    ) -> Result<(), LanguageError> {
        texts.sort_unstable();
        texts.dedup();
        if self.cache.len() + texts.len() > CACHED_TEXTS {
            self.cache.clear();
        }
        let [rows, columns] = self.grid;
        let cells = rows * columns;
        for some in texts.chunks(cells) {
            let embed = |text: &&str| (self.embed)(text);
            let embeddings: Vec<Arc<[f32]>> = some
                .iter()
                .map(embed)
                .collect::<Result<_, _>>()
                .map_err(|reason| LanguageError::Text { reason })?;
            let size = embeddings[0].len();
            let mut planes = vec![0.0; size * cells];
            for (cell, embedding) in embeddings.iter().enumerate() {
                for (channel, value) in embedding.iter().enumerate() {
                    planes[channel * cells + cell] = *value;
                }
            }
            let codes =
                compressor.compress(&[Tensor::floats(&[1, size, rows, columns], planes)])?;
            let codes = codes.codes.chunks_exact(GENERIC_SIZE);
            self.cache.extend(some.iter().zip(codes).map(|(text, code)| {
                let code = code.try_into().expect("a chunk has as many values as a code");
                ((*text).to_owned(), code)
            }));
        }
        Ok(())
    }
}

/// Columns and rows of the grid over an image of (width, height). Cells are squares of whole
/// pixels, as small as gives at most `columns` columns.
pub(super) fn size((width, height): (usize, usize), columns: usize) -> [usize; 2] {
    let side = width.div_ceil(columns).max(1);
    [width.div_ceil(side), height.div_ceil(side)]
}

/// The majority label of each cell of a grid over the whole image; `from` and `to` are (width,
/// height).
pub(super) fn majority(ids: &[u16], from: (usize, usize), to: (usize, usize)) -> Vec<u16> {
    let span = |at: usize, from: usize, to: usize| {
        let start = at * from / to;
        start..((at + 1) * from / to).max(start + 1)
    };
    let mut cell = Vec::new();
    let mut found = Vec::with_capacity(to.0 * to.1);
    for row in 0..to.1 {
        for column in 0..to.0 {
            cell.clear();
            for y in span(row, from.1, to.1) {
                cell.extend_from_slice(&ids[y * from.0..][span(column, from.0, to.0)]);
            }
            cell.sort_unstable();
            let runs = cell.chunk_by(|a, b| a == b);
            // On ties `max_by_key` returns the last: the smallest label must come last.
            let most = runs.rev().max_by_key(|run| run.len()).expect("a cell has a pixel");
            found.push(most[0]);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_takes_the_majority_label() {
        #[rustfmt::skip]
        let ids = [
            1, 1, 2, 2, 0, 0,
            1, 3, 2, 4, 5, 0,
            7, 8, 9, 9, 6, 6,
            8, 7, 9, 0, 6, 6,
        ];
        // On ties (7 and 8) the smallest.
        assert_eq!(majority(&ids, (6, 4), (3, 2)), [1, 2, 0, 7, 9, 6]);
        assert_eq!(majority(&ids, (6, 4), (6, 4)), ids);
        // One cell: 0 and 6 have four pixels each.
        assert_eq!(majority(&ids, (6, 4), (1, 1)), [0]);
    }

    #[test]
    fn cells_are_whole_pixels_and_the_grid_has_at_most_the_given_columns() {
        assert_eq!(size((600, 340), 300), [300, 170]);
        assert_eq!(size((640, 480), 300), [214, 160], "three pixels to a cell");
        assert_eq!(size((96, 72), 300), [96, 72], "never finer than the labels");
    }

    #[test]
    fn a_grid_finer_than_the_image_repeats_pixels() {
        assert_eq!(majority(&[1, 2, 3, 4], (2, 2), (4, 2)), [1, 1, 2, 2, 3, 3, 4, 4]);
    }
}
