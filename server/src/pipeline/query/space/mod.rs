//! Questions about the whole map: the codes of all Gaussians are decoded and compared with the
//! texts, and relevant Gaussians are clustered to objects.

mod boxes;
mod clusters;
mod features;
mod filter;
mod gaussian;
mod neighbours;
mod objects;
mod search;
mod segments;
mod surface;

pub(super) use features::SpaceFeatureCache;
pub(super) use search::{search, segment};

#[cfg(test)]
mod tests;
