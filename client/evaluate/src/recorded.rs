//! A data set that records the true poses of the frames that are read, so that frames need not be
//! read or rendered again for comparison.

use crate::trajectory::StampedPose;
use lexsplat_client::dataset::{Dataset, DatasetError, Layer, RgbdFrame};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// A frame that was read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Position in the data set.
    pub index: usize,
    /// Number of the frame.
    pub sequence: u64,
    /// Timestamp, nanoseconds.
    pub nanos: u64,
    /// The true pose, if the data set has one.
    pub truth: Option<StampedPose>,
}

/// A data set with a record of the frames that were read.
pub struct Recorded {
    dataset: Arc<dyn Dataset>,
    seen: Mutex<BTreeMap<usize, Seen>>,
}

impl Recorded {
    /// An empty record.
    pub fn new(dataset: Arc<dyn Dataset>) -> Self {
        Self { dataset, seen: Mutex::default() }
    }

    /// The frames that were read, in order.
    pub fn seen(&self) -> Vec<Seen> {
        let seen = self.seen.lock().expect("no thread panics while it holds this");
        seen.values().copied().collect()
    }
}

impl Layer for Recorded {
    fn below(&self) -> &dyn Dataset {
        &*self.dataset
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, DatasetError> {
        let frame = self.dataset.frame(index)?;
        let (sequence, nanos) = (frame.sequence, frame.timestamp_nanos);
        let truth = frame
            .world_from_camera
            .map(|world_from_camera| StampedPose { nanos, world_from_camera });
        let mut seen = self.seen.lock().expect("no thread panics while it holds this");
        seen.insert(index, Seen { index, sequence, nanos, truth });
        Ok(frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lexsplat_client::dataset::FrameRange;
    use lexsplat_synthetic::SyntheticDataset;

    #[test]
    fn frames_that_were_read_are_recorded_in_order() {
        let range = FrameRange { end: Some(3), ..FrameRange::default() };
        let dataset = range.of(Box::new(SyntheticDataset::new(3))).unwrap();
        let recorded = Recorded::new(Arc::from(dataset));
        assert!(recorded.seen().is_empty());
        let read: &dyn Dataset = &recorded;
        let frame = read.frame(2).unwrap();
        read.frame(0).unwrap();
        let seen = recorded.seen();
        assert_eq!(seen.iter().map(|seen| seen.index).collect::<Vec<_>>(), [0, 2]);
        let truth = seen[1].truth.unwrap();
        assert_eq!(
            (truth.nanos, Some(truth.world_from_camera)),
            (frame.timestamp_nanos, frame.world_from_camera)
        );
    }
}
