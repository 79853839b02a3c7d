//! **Evaluation** of a map: [`evaluate`] streams a data set to a server, waits until the map is
//! settled and measures the quantities of the paper: speed, trajectory, views, language.
//!
//! It needs a running server ([`Target`]) and returns an [`Evaluation`] with a [`Report`], the
//! trajectories for plots and some images. It writes no file and starts no server.

mod clouds;
mod context;
mod error;
mod heatmap;
mod image_metrics;
mod labels;
mod language;
mod letters;
mod lpips;
mod options;
pub mod overlay;
pub mod plot;
mod presence;
mod probe;
mod process;
mod recorded;
mod report;
mod run;
mod runtime;
mod samples;
mod score;
mod selection;
mod space;
mod stages;
mod statistics;
mod step;
pub mod table;
mod trajectory;
mod uncertainty;
mod versus;
mod views;
mod words;

pub use clouds::{Point, chamfer, earth_movers, resampled};
pub use error::EvaluateError;
pub use heatmap::Heatmap;
pub use image_metrics::{DepthError, depth_error, psnr_db, ssim};
pub use labels::{LabelFile, LabelFileError, LabelSource};
pub use language::{ClassScore, LabelMeans, LabelScore, Language, Latency, MaskMeans, MaskScore};
pub use lpips::{Lpips, LpipsError};
pub use options::{Options, Target};
pub use presence::{Bin, Fitted, Judgement, Presence, Reliability};
pub use probe::{Probe, ProbeTimes, REFERENCE, Reference, Repeated};
pub use report::{LabelTable, Paper, Refined, Report, Row, Scaled, label_table, markdown, rows};
pub use run::{Evaluation, evaluate};
pub use samples::Sample;
pub use score::{Bounds, as_released, average_precision, boxes, iou};
pub use space::{CountScore, Space, SpaceMeans, SpaceScore};
pub use stages::Stage;
pub use step::Step;
pub use trajectory::{Ate, StampedPose, align, ate, paired, read_tum};
pub use uncertainty::{Part, Uncertainty};
pub use versus::{Comparison, Quantity, Ratio};
pub use views::{HELD_OUT_EVERY, ViewMeans, ViewScore};
