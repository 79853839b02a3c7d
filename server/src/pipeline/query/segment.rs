//! The answer to a [`Contest`]: which of several texts is each pixel of a view, or each Gaussian.

use super::answer::{LabelImage, Segmentation, Timing};
use super::request::Contest;
use super::rivals::{self, Rivals};
use super::thread::{Worker, lap, milliseconds};
use super::{QueryError, viewpoint};
use crate::pipeline::snapshot::MapSnapshot;
use lexsplat_gpu::Camera;
use std::time::Instant;

/// As near to a text as to the nearest negative.
const EVEN: f32 = 0.5;

/// How the pixels of a view are labelled.
struct Pixels {
    camera: Camera,
    /// Side of the mean filter, pixels.
    side: usize,
    threshold: f32,
}

impl Worker {
    /// Compares the texts with each other.
    pub(super) fn segmentation(
        &mut self,
        snapshot: &MapSnapshot,
        contest: &Contest,
        since: Instant,
    ) -> Result<Segmentation, QueryError> {
        let threshold = contest.threshold.unwrap_or(EVEN);
        if !(0.0..=1.0).contains(&threshold) {
            return Err(QueryError::BadThreshold { found: threshold });
        }
        let mut clock = Instant::now();
        let rivals = self.words.rivals(contest)?;
        let text = lap(&mut clock);
        let mut found = match &contest.view {
            Some(view) => {
                let camera = viewpoint::camera(snapshot, view)?;
                let side = self.config.smoothing(contest.smoothing_pixels, camera.width);
                let pixels = Pixels { camera, side, threshold };
                self.segment_view(snapshot, &rivals, &pixels)?
            }
            None => self.segment_space(snapshot, &rivals, threshold)?,
        };
        found.timing.text = text;
        found.timing.total = milliseconds(since);
        Ok(found)
    }

    fn segment_view(
        &mut self,
        snapshot: &MapSnapshot,
        rivals: &Rivals,
        pixels: &Pixels,
    ) -> Result<Segmentation, QueryError> {
        let Pixels { camera, side, threshold } = pixels;
        let mut timing = Timing::default();
        let features = self.features(snapshot, camera, &mut timing)?;
        let mut clock = Instant::now();
        let planes: Vec<_> = features
            .relevancies(rivals, camera)
            .into_iter()
            .map(|plane| plane.smoothed(*side))
            .collect();
        let labels = rivals::labels(&planes, *threshold);
        let shares = rivals::shares(labels.iter().copied(), rivals.len());
        timing.score = lap(&mut clock);
        Ok(Segmentation {
            revision: snapshot.revision,
            coverage: features.coverage(),
            threshold: *threshold,
            shares,
            image: Some(LabelImage { width: camera.width, height: camera.height, labels }),
            points: None,
            timing,
        })
    }

    fn segment_space(
        &mut self,
        snapshot: &MapSnapshot,
        rivals: &Rivals,
        threshold: f32,
    ) -> Result<Segmentation, QueryError> {
        let mut timing = Timing::default();
        let mut clock = Instant::now();
        self.space.prepare(&mut self.decoder, snapshot, self.feature_size)?;
        timing.decode = lap(&mut clock);
        let found = self.space.labels(&mut self.decoder, snapshot, rivals, threshold)?;
        let shares = rivals::shares(found.points.iter().map(|point| point.label), rivals.len());
        timing.score = lap(&mut clock);
        Ok(Segmentation {
            revision: snapshot.revision,
            coverage: found.coverage,
            threshold,
            shares,
            image: None,
            points: Some(found.points),
            timing,
        })
    }
}
