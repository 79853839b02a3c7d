//! Two-stage compression of language features (paper §4.2, "Two-Stage Online CLIP Compression").
//!
//! The first stage (D -> 32) is pre-trained and part of the bundle: `generic`. The second stage
//! (32 -> 15) is learned online: [`OnlineStage`]. A keyframe keeps its 32-channel codes. Each
//! 15-channel code belongs to a version of the online stage and is converted when the version
//! increases ([`carry_over`]).

mod config;
mod dictionary;
pub(crate) mod generic;
mod linear;
mod mlp;
mod online_stage;
mod rows;

pub use super::network::GENERIC_SIZE;
pub use config::{CompressorConfig, Stage};
pub use online_stage::{OnlineStage, carry_over};

#[cfg(test)]
pub(crate) use rows::normalise_rows;

use linear::Linear;
use mlp::Mlp;

/// The configured online stage, before any keyframe.
pub fn online(config: &CompressorConfig) -> Box<dyn OnlineStage> {
    match config.stage {
        Stage::Linear => Box::new(Linear::new(config.code_size, config.tolerance)),
        Stage::Mlp => Box::new(Mlp::new(config)),
    }
}

/// The configured online stage in a state that [`OnlineStage::save`] wrote.
///
/// # Errors
/// If the bytes are not of the configured stage.
pub fn restored(
    config: &CompressorConfig,
    saved: &[u8],
) -> Result<Box<dyn OnlineStage>, rmp_serde::decode::Error> {
    let odd = || rmp_serde::decode::Error::Syntax("the parts do not fit together".into());
    Ok(match config.stage {
        Stage::Linear => {
            let linear = rmp_serde::from_slice::<Linear>(saved)?;
            Box::new(linear.restored().ok_or_else(odd)?)
        }
        Stage::Mlp => Box::new(rmp_serde::from_slice::<Mlp>(saved)?),
    })
}

#[cfg(test)]
mod tests;
