//! Maps on the device: decisions and orders exactly as the oracle has them, and training that does
//! not notice which Gaussians were removed.

mod edit;
mod morton;
mod motion;
mod prune;
mod speed;

pub use crate::support::pick;
use lexsplat_gpu::{Gaussians, Gpu, HostGaussians};

const LENGTHS: [usize; 9] = [0, 1, 2, 63, 64, 65, 1023, 1025, 5003];
const CHANNELS: usize = 5;
/// Opacity that Gaussians of the test scenes have on both sides.
const MIN_OPACITY: f32 = 0.3;

fn map(gpu: &Gpu, host: &HostGaussians) -> Gaussians {
    let mut map = Gaussians::new(gpu, host.language.channels);
    map.append(host).expect("fits");
    map
}

/// Makes the Gaussians without a flag transparent in both heads, and all others opaque.
fn mark(host: &HostGaussians, keep: &[bool]) -> HostGaussians {
    let mut host = host.clone();
    for (i, keep) in keep.iter().enumerate() {
        let logit = if *keep { 2.0 } else { -9.0 };
        (host.color.opacity_logits[i], host.language.opacity_logits[i]) = (logit, logit);
    }
    host
}
