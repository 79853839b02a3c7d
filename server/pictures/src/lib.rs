//! **Pictures**: what is computed for every pixel of color and depth on the host.
//!
//! In: color and depth of one size, row by row. Out: smaller pictures, depth with its thin gaps closed,
//! corners with descriptors, their matches between two pictures, and the motion that most of them agree
//! with.
//!
//! It is a package of its own because it computes for every pixel: it is optimised in each profile.

mod corners;
mod descriptor;
mod feature_pose;
mod features;
mod gaps;
mod grey;
mod picture;
mod smaller;

pub use feature_pose::FeaturePose;
pub use features::Features;
pub use gaps::without_gaps;
pub use grey::Grey;
pub use picture::Picture;
pub use smaller::smaller;

#[cfg(test)]
mod tests;
