//! The figures of the paper, for comparison.

use serde::Serialize;

/// What the paper says of its own runs: means over the Replica scenes of vMAP, tracked poses.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Paper {
    /// Table 1.
    pub miou: f64,
    /// Table 1.
    pub loc_accuracy: f64,
    /// Supplement, 3D localisation, failures left out, metres.
    pub chamfer_m: f64,
    /// The same; of pairs that are not one to one.
    pub emd_m: f64,
    /// Rendering.
    pub psnr_db: f64,
    /// Rendering.
    pub ssim: f64,
    /// Rendering, AlexNet.
    pub lpips: f64,
    /// Tracking.
    pub ate_rmse_cm: f64,
    /// On one large GPU, least and most.
    pub seconds_per_frame: [f64; 2],
}

/// The paper's figures.
pub const PAPER: Paper = Paper {
    miou: 0.487,
    loc_accuracy: 0.826,
    chamfer_m: 0.736,
    emd_m: 5.695,
    psnr_db: 35.81,
    ssim: 0.950,
    lpips: 0.072,
    ate_rmse_cm: 0.397,
    seconds_per_frame: [0.6, 0.8],
};
