//! Questions about one view (paper §5): codes are rendered at a low resolution, decoded and
//! compared with the texts, and the relevancy is interpolated to the size of the view.

mod components;
mod features;
mod search;

pub(super) use features::ViewFeatureCache;
pub(super) use search::{search, segment};
