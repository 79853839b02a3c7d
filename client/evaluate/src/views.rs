//! Rendered against true pictures. In: which frames, a server that renders them, the data set. Out:
//! PSNR, SSIM and depth error of each frame, and LPIPS where there is a network for it.
//!
//! Held out are every fifth of the tracked frames that are no keyframe: nothing in the map was
//! optimised for them. They and the keyframes are rendered at the tracked pose, at the frame's size.

use crate::context::{Context, decoded};
use crate::error::EvaluateError;
use crate::image_metrics::{depth_error, psnr_db, ssim};
use crate::lpips::Lpips;
use crate::statistics::mean;
use crate::step::Step;
use image::RgbImage;
use lexsplat_client::dataset::{Dataset, RgbdFrame};
use serde::Serialize;

/// Of the tracked frames that are no keyframe, every so many are rendered.
pub const HELD_OUT_EVERY: usize = 5;

/// One rendered frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewScore {
    /// The frame.
    pub sequence: u64,
    /// Whether the map was optimised for it.
    pub keyframe: bool,
    /// Decibels.
    pub psnr_db: f64,
    /// 0 to 1.
    pub ssim: f64,
    /// Absent without a network.
    pub lpips: Option<f64>,
    /// Metres; absent if nothing can be compared.
    pub depth_l1_m: Option<f64>,
    /// Of the measured pixels, the share that the map renders.
    pub depth_share: Option<f64>,
}

/// Means over frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ViewMeans {
    /// How many.
    pub views: usize,
    /// Mean of the frames' values.
    pub psnr_db: Option<f64>,
    /// Mean of the frames' values.
    pub ssim: Option<f64>,
    /// Mean of the frames' values.
    pub lpips: Option<f64>,
    /// Mean of the frames' values, metres.
    pub depth_l1_m: Option<f64>,
    /// Mean of the frames' values.
    pub depth_share: Option<f64>,
}

impl ViewMeans {
    /// Of some frames.
    pub fn of<'a>(views: impl Iterator<Item = &'a ViewScore> + Clone) -> Self {
        Self {
            views: views.clone().count(),
            psnr_db: mean(views.clone().map(|view| view.psnr_db)),
            ssim: mean(views.clone().map(|view| view.ssim)),
            lpips: mean(views.clone().filter_map(|view| view.lpips)),
            depth_l1_m: mean(views.clone().filter_map(|view| view.depth_l1_m)),
            depth_share: mean(views.filter_map(|view| view.depth_share)),
        }
    }
}

/// A frame to render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SelectedView {
    /// Position in the data set.
    pub index: usize,
    /// Whether the map was optimised for it.
    pub keyframe: bool,
}

/// Renders and compares these frames.
pub(crate) async fn score(
    context: &Context<'_>,
    selected: &[SelectedView],
    mut lpips: Option<Lpips>,
    on_step: &mut impl FnMut(Step<'_>),
) -> Result<Vec<ViewScore>, EvaluateError> {
    let mut scores = Vec::with_capacity(selected.len());
    for (done, &SelectedView { index, keyframe }) in selected.iter().enumerate() {
        on_step(Step::Rendering { done, of: selected.len() });
        let frame = context.dataset.frame(index)?;
        let sequence = frame.sequence;
        let truth = color(&frame)?;
        let rendered = context.render(sequence).await?;
        if truth.dimensions() != rendered.dimensions() {
            let (expected, found) = (truth.dimensions(), rendered.dimensions());
            return Err(EvaluateError::Size { sequence, expected, found });
        }
        let depth = context.client.render_depth(context.map, sequence).await?;
        let measured = depth_metres(&frame, context.dataset)?;
        if measured.len() != depth.values.len() {
            let (expected, found) = (truth.dimensions(), (depth.values.len() as u32, 1));
            return Err(EvaluateError::Size { sequence, expected, found });
        }
        let depth = depth_error(&measured, &depth.values);
        let lpips =
            lpips.as_mut().map(|network| network.distance(&truth, &rendered)).transpose()?;
        scores.push(ViewScore {
            sequence,
            keyframe,
            psnr_db: psnr_db(&truth, &rendered),
            ssim: ssim(&truth, &rendered),
            lpips,
            depth_l1_m: depth.map(|error| error.l1_metres),
            depth_share: depth.map(|error| error.rendered_share),
        });
    }
    on_step(Step::Rendering { done: selected.len(), of: selected.len() });
    Ok(scores)
}

/// A frame's picture.
pub fn color(frame: &RgbdFrame) -> Result<RgbImage, EvaluateError> {
    decoded(&frame.color.bytes, frame.sequence).map(|picture| picture.to_rgb8())
}

/// A frame's depth, metres; 0 where nothing was measured.
pub fn depth_metres(frame: &RgbdFrame, dataset: &dyn Dataset) -> Result<Vec<f32>, EvaluateError> {
    let unit = dataset.depth_unit_metres();
    let depth = decoded(&frame.depth.bytes, frame.sequence)?.to_luma16();
    // The greatest value is "nothing" or "beyond the range".
    let metres =
        |units: &u16| if *units == u16::MAX { 0.0 } else { (f64::from(*units) * unit) as f32 };
    Ok(depth.as_raw().iter().map(metres).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_over_what_is_there() {
        let view = |psnr_db, depth_l1_m| ViewScore {
            sequence: 0,
            keyframe: false,
            psnr_db,
            ssim: 0.5,
            lpips: (psnr_db > 25.0).then_some(0.25),
            depth_l1_m,
            depth_share: None,
        };
        let views = [view(20.0, Some(0.1)), view(30.0, None)];
        let means = ViewMeans::of(views.iter());
        assert_eq!((means.views, means.psnr_db, means.ssim), (2, Some(25.0), Some(0.5)));
        assert_eq!((means.depth_l1_m, means.depth_share), (Some(0.1), None));
        assert_eq!(means.lpips, Some(0.25));
        assert_eq!(ViewMeans::of([].iter()), ViewMeans::default());
    }
}
