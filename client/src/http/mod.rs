//! The server's HTTP interface: [`HttpClient`] and the types of its questions and answers.

mod client;
mod error;
mod settle;
mod wire;

pub use client::HttpClient;
pub use error::HttpError;
pub use wire::{
    Answer, Bounds, Camera, FrameView, Health, HeatmapLink, Keyframe, LabelsLink, LegendEntry,
    Object, Peak, PixelBox, PointsLink, Question, Rle, Segmentation, Status, Timing,
};
