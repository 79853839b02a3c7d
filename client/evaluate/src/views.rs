//! Rendered views, scored against the frames: PSNR, SSIM and depth error, and LPIPS if there is a
//! network.
//!
//! The map is optimised on keyframes only, so other tracked frames are held out. Views are rendered
//! at the tracked pose and at the size of the frame. If a sensor was simulated, they are compared
//! with the clean frames, so that a map that learns the sensor's noise does not score for it.

use crate::context::Context;
use crate::error::EvaluateError;
use crate::image_metrics::{depth_error, psnr_db, ssim};
use crate::lpips::Lpips;
use crate::statistics::mean;
use crate::step::Step;
use serde::Serialize;

/// Without an explicit choice, every fifth of the tracked frames that are no keyframe is held out.
pub const HELD_OUT_EVERY: usize = 5;

/// Scores of a rendered view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewScore {
    /// Number of the frame.
    pub sequence: u64,
    /// Whether the map was optimised for it.
    pub keyframe: bool,
    /// PSNR, decibels.
    pub psnr_db: f64,
    /// SSIM, 0 to 1.
    pub ssim: f64,
    /// LPIPS; absent without a network.
    pub lpips: Option<f64>,
    /// Mean depth error, metres; absent if no pixel can be compared.
    pub depth_l1_m: Option<f64>,
    /// Share of the measured pixels that the map renders.
    pub depth_share: Option<f64>,
}

/// Means over views.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ViewMeans {
    /// Number of views.
    pub views: usize,
    /// Mean PSNR, decibels.
    pub psnr_db: Option<f64>,
    /// Mean SSIM.
    pub ssim: Option<f64>,
    /// Mean LPIPS.
    pub lpips: Option<f64>,
    /// Mean depth error, metres.
    pub depth_l1_m: Option<f64>,
    /// Mean share of measured pixels that are rendered.
    pub depth_share: Option<f64>,
}

impl ViewMeans {
    /// Means over some views.
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
        let frame = context.dataset.clean_frame(index)?;
        let sequence = frame.sequence;
        let truth = frame.rgb(&context.dataset.intrinsics())?;
        let rendered = context.render(sequence).await?;
        if truth.dimensions() != rendered.dimensions() {
            let (expected, found) = (truth.dimensions(), rendered.dimensions());
            return Err(EvaluateError::Size { sequence, expected, found });
        }
        let depth = context.client.render_depth(context.map, sequence).await?;
        let measured = frame.depth_metres(context.dataset.depth_unit_metres())?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_over_the_values_that_exist() {
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
