//! The 32-D codes of an image, in half precision. Codes of labels are few different ones, which are kept
//! once.

use super::super::compressor::GENERIC_SIZE;
use half::f16;
use half::slice::HalfFloatSliceExt as _;
use std::collections::HashMap;

/// Different codes that are looked for: more are hardly ever those of labels.
const MOST_DIFFERENT: usize = 4096;

/// A code for each pixel.
pub(in super::super) enum Codes {
    /// `[pixels * 32]`.
    Each(Vec<f16>),
    /// The different codes, `[n * 32]`, and which of them each pixel has.
    Few { different: Vec<f16>, of_pixel: Vec<u16> },
}

impl Codes {
    /// Keeps codes `[pixels * 32]`; they come back with the same bits.
    pub fn new(codes: Vec<f16>) -> Self {
        let mut known: HashMap<&[u16], u16> = HashMap::new();
        let rows = codes.reinterpret_cast().chunks_exact(GENERIC_SIZE);
        let most = MOST_DIFFERENT.min(rows.len() / 2);
        let (mut different, mut of_pixel) = (Vec::new(), Vec::with_capacity(rows.len()));
        for row in rows {
            let next = known.len() as u16;
            let index = *known.entry(row).or_insert(next);
            if index == next {
                if known.len() > most {
                    return Self::Each(codes);
                }
                different.extend(row.iter().copied().map(f16::from_bits));
            }
            of_pixel.push(index);
        }
        Self::Few { different, of_pixel }
    }

    /// The codes, `[pixels * 32]`.
    pub fn all(&self) -> Vec<f16> {
        match self {
            Self::Each(codes) => codes.clone(),
            Self::Few { different, of_pixel } => {
                let code = |index: &u16| &different[usize::from(*index) * GENERIC_SIZE..];
                of_pixel.iter().flat_map(|index| &code(index)[..GENERIC_SIZE]).copied().collect()
            }
        }
    }

    /// The code of a pixel.
    pub fn of(&self, pixel: usize) -> [f32; GENERIC_SIZE] {
        let row = match self {
            Self::Each(codes) => &codes[pixel * GENERIC_SIZE..],
            Self::Few { different, of_pixel } => {
                &different[usize::from(of_pixel[pixel]) * GENERIC_SIZE..]
            }
        };
        std::array::from_fn(|channel| row[channel].to_f32())
    }

    /// Memory, bytes.
    pub fn bytes(&self) -> u64 {
        let bytes = match self {
            Self::Each(codes) => size_of_val(&codes[..]),
            Self::Few { different, of_pixel } => {
                size_of_val(&different[..]) + size_of_val(&of_pixel[..])
            }
        };
        bytes as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Codes of so many pixels, of which `different` differ.
    fn codes(pixels: usize, different: usize) -> Vec<f16> {
        let value = |at: usize| (at / GENERIC_SIZE % different * 37 + at % GENERIC_SIZE) as f32;
        (0..pixels * GENERIC_SIZE).map(|at| f16::from_f32(value(at) / 4096.0)).collect()
    }

    #[test]
    fn few_codes_are_kept_once_and_all_come_back() {
        let bytes = |different: usize| {
            let kept = codes(1000, different);
            let found = Codes::new(kept.clone());
            assert!(found.all() == kept, "{different}");
            found.bytes()
        };
        assert_eq!(bytes(10), 10 * 64 + 1000 * 2);
        assert_eq!(bytes(1000), 1000 * 64, "negative control: all differ");
        assert!(Codes::new(Vec::new()).all().is_empty());
        // Zero has two signs, and what comes back has the same.
        let signed: Vec<f16> = [0.0, -0.0].map(|zero| [f16::from_f32(zero); 32]).concat();
        let bits = |codes: &[f16]| codes.iter().map(|code| code.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&Codes::new(signed.clone()).all()), bits(&signed));
    }
}
