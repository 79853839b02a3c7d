//! Frames in which the sensor sees nothing: black pictures without depth, as of a covered lens or a
//! dropped connection. Poses, truth and clean frames stay.

use crate::encode::{rgb_jpeg, units_png};
use lexsplat_client::dataset::{
    ColorFormat, Dataset, DatasetError, DepthFormat, Intrinsics, Layer, RgbdFrame,
};
use std::fmt;
use std::num::NonZeroUsize;
use std::str::FromStr;

/// Which frames are black, by position from 0 among the frames that are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blackout {
    /// From the first position up to, not including, the second.
    Range(usize, usize),
    /// The last of every N frames.
    Every(NonZeroUsize),
}

impl Blackout {
    /// The data set with these frames black.
    pub fn of(self, dataset: Box<dyn Dataset>) -> Box<dyn Dataset> {
        Box::new(Blacked { dataset, blackout: self })
    }

    fn holds(self, position: usize) -> bool {
        match self {
            Self::Range(start, end) => (start..end).contains(&position),
            Self::Every(every) => (position + 1).is_multiple_of(every.get()),
        }
    }
}

impl FromStr for Blackout {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("expected START..END or every:N, found {text:?}");
        if let Some(every) = text.strip_prefix("every:") {
            return every.parse().map(Self::Every).map_err(|_| wrong());
        }
        let (start, end) = text.split_once("..").ok_or_else(wrong)?;
        let number = |text: &str| text.parse::<usize>().map_err(|_| wrong());
        let (start, end) = (number(start)?, number(end)?);
        if start < end { Ok(Self::Range(start, end)) } else { Err(wrong()) }
    }
}

impl fmt::Display for Blackout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Range(start, end) => write!(f, "frames {start}..{end} black"),
            Self::Every(every) => write!(f, "one of every {every} frames black"),
        }
    }
}

struct Blacked {
    dataset: Box<dyn Dataset>,
    blackout: Blackout,
}

impl Layer for Blacked {
    fn below(&self) -> &dyn Dataset {
        &*self.dataset
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        if !self.blackout.holds(index) {
            return self.dataset.frame(index);
        }
        // The clean frame is cheaper, and all of it but its pictures is the same.
        let mut frame = self.dataset.clean_frame(index)?;
        let Intrinsics { width, height, .. } = self.below().intrinsics();
        let pixels = width as usize * height as usize;
        let failed = |source| DatasetError::Encode { sequence: frame.sequence, source };
        frame.color.bytes = rgb_jpeg(width, height, &vec![0; 3 * pixels]).map_err(failed)?;
        frame.color.format = ColorFormat::Jpeg;
        let nothing = std::iter::repeat_n(0, pixels);
        frame.depth.bytes = units_png(width, height, nothing).map_err(failed)?;
        frame.depth.format = DepthFormat::Png16;
        Ok(frame)
    }

    fn simulated(&self) -> Option<String> {
        let before = self.dataset.simulated().map(|words| words + ", ");
        Some(format!("{}{}", before.unwrap_or_default(), self.blackout))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{SyntheticDataset, Walk};
    use crate::sensor::clean::Clean;

    #[test]
    fn blackouts_are_read_and_hold_what_they_say() {
        let parse = |text: &str| text.parse::<Blackout>();
        let range = parse("2..4").unwrap();
        assert_eq!([1, 2, 3, 4].map(|i| range.holds(i)), [false, true, true, false]);
        let every = parse("every:3").unwrap();
        assert_eq!([0, 1, 2, 3, 5].map(|i| every.holds(i)), [false, false, true, false, true]);
        for wrong in ["", "4", "4..", "4..4", "5..2", "every:0", "every:", "-1..2"] {
            let error = parse(wrong).unwrap_err();
            assert!(error.contains("expected START..END or every:N"), "{error}");
        }
    }

    #[test]
    fn black_frames_show_nothing_and_the_others_are_unchanged() {
        let dataset = || Box::new(SyntheticDataset::of(&Walk { frames: 3, ..Walk::new(3) }));
        let (plain, black) = (dataset(), Blackout::Range(1, 2).of(dataset()));
        assert_eq!(black.frame(0).unwrap(), plain.frame(0).unwrap());
        let (dark, clean) = (black.frame(1).unwrap(), plain.frame(1).unwrap());
        let seen = Clean::of(&dark, black.intrinsics(), 1.0).unwrap();
        assert!(
            seen.depth.iter().all(|z| *z == 0.0) && seen.light.iter().flatten().all(|l| *l == 0.0)
        );
        assert_eq!(dark.world_from_camera, clean.world_from_camera);
        assert_eq!(black.clean_frame(1).unwrap(), clean);
        assert_eq!(black.simulated().unwrap(), "frames 1..2 black");
        assert_eq!(plain.simulated(), None);
    }
}
