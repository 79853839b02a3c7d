//! The map under evaluation and the requests that several scores share.

use crate::error::EvaluateError;
use crate::heatmap::Heatmap;
use image::{DynamicImage, RgbImage};
use lexsplat_client::dataset::Dataset;
use lexsplat_client::http::{Answer, HeatmapLink, HttpClient, Question};
use std::time::{Duration, Instant};

/// The map under evaluation and the data set that it was made of.
pub(crate) struct Context<'a> {
    pub client: &'a HttpClient,
    pub map: &'a str,
    pub dataset: &'a dyn Dataset,
}

impl Context<'_> {
    /// The map rendered at the pose of a frame.
    pub async fn render(&self, sequence: u64) -> Result<RgbImage, EvaluateError> {
        let file = self.client.render_png(self.map, sequence).await?;
        Ok(decoded(&file, sequence)?.to_rgb8())
    }

    /// Asks about a frame.
    pub async fn relevancy(&self, text: &str, frame: u64) -> Result<Relevancy, EvaluateError> {
        let question = Question { smoothing: Some(0), ..Question::in_frame(text, frame) };
        let asked = Instant::now();
        let answer = self.client.query(self.map, &question).await?;
        let took = asked.elapsed();
        let heatmap = self.image(text, answer.heatmap.as_ref()).await?;
        Ok(Relevancy { answer, heatmap, took })
    }

    /// Fetches an image of an answer about a frame.
    pub async fn image(
        &self,
        text: &str,
        link: Option<&HeatmapLink>,
    ) -> Result<Heatmap, EvaluateError> {
        let missing = || EvaluateError::Answer { reason: format!("{text:?} has no heat map") };
        let (array, _) = self.client.heatmap(link.ok_or_else(missing)?).await?;
        Ok(Heatmap { width: array.shape[1], values: array.values })
    }
}

/// An answer about a frame.
pub(crate) struct Relevancy {
    pub answer: Answer,
    /// Relevancy of each pixel, not smoothed.
    pub heatmap: Heatmap,
    /// From the request to the answer.
    pub took: Duration,
}

/// Decodes an encoded image of a frame.
pub(crate) fn decoded(file: &[u8], sequence: u64) -> Result<DynamicImage, EvaluateError> {
    image::load_from_memory(file).map_err(|source| EvaluateError::Picture { sequence, source })
}
