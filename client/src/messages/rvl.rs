//! RVL, the lossless code for depth of A. D. Wilson (Fast Lossless Depth Image Compression, 2017), as ROS
//! writes it: runs of zeros and of differences, each number in groups of three bits.

/// Groups of three bits with a bit that says whether another one follows, in little-endian words, first group
/// uppermost.
struct Nibbles<'a> {
    words: std::slice::ChunksExact<'a, u8>,
    word: u32,
    left: u32,
}

impl Nibbles<'_> {
    /// The next number; `None` at the end or if it is longer than 30 bits.
    fn number(&mut self) -> Option<u32> {
        let mut value = 0;
        for shift in (0..30).step_by(3) {
            if self.left == 0 {
                let bytes = self.words.next()?;
                self.word = u32::from_le_bytes(bytes.try_into().ok()?);
                self.left = 8;
            }
            let nibble = self.word >> 28;
            self.word <<= 4;
            self.left -= 1;
            value |= (nibble & 7) << shift;
            if nibble & 8 == 0 {
                return Some(value);
            }
        }
        None
    }
}

/// `pixels` values; `None` if the code is damaged.
pub(super) fn decoded(code: &[u8], pixels: usize) -> Option<Vec<u16>> {
    let mut nibbles = Nibbles { words: code.chunks_exact(4), word: 0, left: 0 };
    // A run of zeros takes a few bits, whatever its length: memory grows with what is decoded.
    let mut values: Vec<u16> = Vec::new();
    let mut value: i32 = 0;
    while values.len() < pixels {
        let left = pixels - values.len();
        let zeros = nibbles.number()? as usize;
        values.resize(values.len() + (zeros <= left).then_some(zeros)?, 0);
        let left = left - zeros;
        let measured = nibbles.number()? as usize;
        for _ in 0..(measured <= left).then_some(measured)? {
            let code = nibbles.number()?;
            let difference = (code >> 1) as i32 ^ -((code & 1) as i32);
            value = value.wrapping_add(difference);
            values.push(value as u16);
        }
        // Damaged code can stand still.
        if zeros + measured == 0 && left > 0 {
            return None;
        }
    }
    Some(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The encoder of the paper.
    fn encoded(values: &[u16]) -> Vec<u8> {
        let mut nibbles = Vec::new();
        let mut put = |mut value: u32| loop {
            let more = value > 7;
            nibbles.push((value & 7) | if more { 8 } else { 0 });
            value >>= 3;
            if !more {
                break;
            }
        };
        let (mut at, mut before) = (0, 0_i32);
        while at < values.len() {
            let zeros = values[at..].iter().take_while(|value| **value == 0).count();
            at += zeros;
            let run = values[at..].iter().take_while(|value| **value != 0).count();
            put(zeros as u32);
            put(run as u32);
            for value in &values[at..at + run] {
                let difference = i32::from(*value) - before;
                put(((difference << 1) ^ (difference >> 31)) as u32);
                before = i32::from(*value);
            }
            at += run;
        }
        let words = nibbles.chunks(8).map(|eight| {
            let word = eight.iter().fold(0, |word, nibble| (word << 4) | nibble);
            word << (4 * (8 - eight.len()))
        });
        words.flat_map(u32::to_le_bytes).collect()
    }

    #[test]
    fn depth_comes_back() {
        let values: Vec<u16> = (0..5000_u32)
            .map(|at| if at % 97 < 30 { 0 } else { (at * 7919 % 60_000) as u16 })
            .collect();
        for values in [&values[..], &values[30..], &[0; 9], &[65_535, 1, 0]] {
            let code = encoded(values);
            assert_eq!(decoded(&code, values.len()).as_deref(), Some(values));
            // Negative control: a code that is cut off is no depth.
            assert_eq!(decoded(&code[..code.len() - 4], values.len()), None);
        }
        assert_eq!(decoded(&[0; 400], 5000), None, "no progress");
        assert_eq!(decoded(&[0xff; 400], usize::MAX), None, "no end");
    }
}
