//! Questions about the whole map: the codes of all Gaussians are decoded and compared with the
//! texts, and relevant Gaussians are clustered to objects.

mod boxes;
mod clusters;
mod features;
mod filter;
mod found;
mod gaussian;
mod neighbours;
mod objects;
mod search;
mod segments;
mod surface;

pub(super) use features::{SpaceFeatureCache, SpaceFeatures};
pub(super) use found::FoundObject;
pub(super) use search::{Found, confidence_of, find, findings, segment};

#[cfg(test)]
pub(super) use gaussian::RelevantGaussian;
#[cfg(test)]
mod tests;
