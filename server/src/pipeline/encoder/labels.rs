//! Language that is given: a frame's label image instead of what the vision networks see.
//!
//! In: [`Labels`] of a frame. Out: a generic code for each cell of a grid over it. Each text is
//! embedded by the text tower and compressed D -> 32 once. A cell takes the label that most of its
//! pixels have (of equals the least): of all that one label per cell can say, this is wrong for the
//! fewest pixels. A cell of "none" has a code of zeros, "no language".

use super::super::compressor::GENERIC;
use super::super::compressor::generic::GenericEncoder;
use super::super::frame::Labels;
use super::super::network::Tensor;
use super::LanguageError;
use std::collections::HashMap;
use std::sync::Arc;

/// A text's embedding `[D]`, unit length, or why there is none.
pub type Embed = Box<dyn FnMut(&str) -> Result<Arc<[f32]>, String> + Send>;

/// Texts whose codes are kept; when there are more, all are made anew.
const KEPT_TEXTS: usize = 1 << 16;

type Code = [f32; GENERIC];

/// Texts to generic codes, each once.
pub(super) struct LabelCodes {
    embed: Embed,
    /// Rows and columns that the compressor takes.
    grid: [usize; 2],
    known: HashMap<String, Code>,
}

impl LabelCodes {
    pub(super) fn new(embed: Embed, grid: [usize; 2]) -> Self {
        Self { embed, grid, known: HashMap::new() }
    }

    /// The code of each label that is in the image; others, and 0, are zeros: `[1 + texts]`.
    pub(super) fn of(
        &mut self,
        compressor: &mut GenericEncoder,
        labels: &Labels,
    ) -> Result<Vec<Code>, LanguageError> {
        let mut is_shown = vec![false; labels.texts.len() + 1];
        labels.ids.iter().for_each(|id| is_shown[usize::from(*id)] = true);
        let shown = |at: &usize| is_shown[at + 1] && !labels.texts[*at].is_empty();
        let shown: Vec<usize> = (0..labels.texts.len()).filter(shown).collect();
        let unknown: Vec<&str> = shown
            .iter()
            .map(|at| labels.texts[*at].as_str())
            .filter(|text| !self.known.contains_key(*text))
            .collect();
        self.learn(compressor, unknown)?;
        let mut codes = vec![[0.0; GENERIC]; is_shown.len()];
        for at in shown {
            codes[at + 1] = self.known[&labels.texts[at]];
        }
        Ok(codes)
    }

    /// Embeds and compresses texts. The compressor works on each cell by itself (paper §4.2), so as
    /// many texts go through it at once as there are cells.
    fn learn(
        &mut self,
        compressor: &mut GenericEncoder,
        mut texts: Vec<&str>,
    ) -> Result<(), LanguageError> {
        texts.sort_unstable();
        texts.dedup();
        if self.known.len() + texts.len() > KEPT_TEXTS {
            self.known.clear();
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
            let codes = codes.codes.chunks_exact(GENERIC);
            self.known.extend(some.iter().zip(codes).map(|(text, code)| {
                let code = code.try_into().expect("a chunk has as many values as a code");
                ((*text).to_owned(), code)
            }));
        }
        Ok(())
    }
}

/// Columns and rows of the grid: cells of as many whole pixels as bring an image of (width, height) to
/// `columns` at most.
pub(super) fn size((width, height): (usize, usize), columns: usize) -> [usize; 2] {
    let side = width.div_ceil(columns).max(1);
    [width.div_ceil(side), height.div_ceil(side)]
}

/// The label of each cell of a grid over the whole image; `from` and `to` are (width, height).
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
            // Of equals `max_by_key` takes the last: the least label must come last.
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
    fn a_cell_is_what_most_of_its_pixels_are() {
        #[rustfmt::skip]
        let ids = [
            1, 1, 2, 2, 0, 0,
            1, 3, 2, 4, 5, 0,
            7, 8, 9, 9, 6, 6,
            8, 7, 9, 0, 6, 6,
        ];
        // Of equals (7 and 8) the least.
        assert_eq!(majority(&ids, (6, 4), (3, 2)), [1, 2, 0, 7, 9, 6]);
        assert_eq!(majority(&ids, (6, 4), (6, 4)), ids);
        // One cell: 0 and 6 are there four times each.
        assert_eq!(majority(&ids, (6, 4), (1, 1)), [0]);
    }

    #[test]
    fn cells_are_whole_pixels_and_the_grid_no_wider_than_asked() {
        assert_eq!(size((600, 340), 300), [300, 170]);
        assert_eq!(size((640, 480), 300), [214, 160], "three pixels to a cell");
        assert_eq!(size((96, 72), 300), [96, 72], "never finer than the labels");
    }

    #[test]
    fn a_grid_finer_than_the_image_repeats_pixels() {
        assert_eq!(majority(&[1, 2, 3, 4], (2, 2), (4, 2)), [1, 1, 2, 2, 3, 3, 4, 4]);
    }
}
