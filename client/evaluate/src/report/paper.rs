//! The figures of the paper, for comparison.

use serde::Serialize;

/// Figures of the paper's own runs: means over the Replica scenes of vMAP, tracked poses.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Paper {
    /// Mean IoU (table 1).
    pub miou: f64,
    /// Localisation accuracy (table 1).
    pub loc_accuracy: f64,
    /// Chamfer distance without failures, metres (supplement, 3D localisation).
    pub chamfer_m: f64,
    /// Earth mover's distance without failures, metres; its pairs are not one to one.
    pub emd_m: f64,
    /// PSNR, decibels.
    pub psnr_db: f64,
    /// SSIM.
    pub ssim: f64,
    /// LPIPS (AlexNet).
    pub lpips: f64,
    /// Trajectory error (RMSE), centimetres.
    pub ate_rmse_cm: f64,
    /// Minimum and maximum seconds per frame, on one large GPU.
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
